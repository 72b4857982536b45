"""Walls and scans to a point cloud (paper, section 2.2)."""
