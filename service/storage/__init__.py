"""Where bytes lie, named by their SHA-256."""
