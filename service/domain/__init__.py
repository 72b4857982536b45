"""Rules of the product: standard library and numpy alone; no input or output, no clock."""
