"""Drawing to walls (paper, section 2.2)."""
