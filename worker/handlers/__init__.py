"""One job kind a file: load, call geometry, judge, record."""
