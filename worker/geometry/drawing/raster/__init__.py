"""Sheets of pixels to walls: paper, ink, strokes, faces (paper, section 2.2)."""
