"""Arrays in, arrays out: pure functions and small frozen values; no database, no network."""
