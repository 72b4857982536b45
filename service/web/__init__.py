"""The dashboard's built files: a client of the public API with no private door."""
