"""Simulated LiDAR (paper, sections 3 and 5)."""
