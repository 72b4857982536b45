"""Walls from closed outlines: a filled area to centre lines and faces."""
