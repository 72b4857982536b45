"""Placing a scan on a map (paper, section 2.3)."""
