"""Simulated LiDAR: triangle scenes, ray casting, and sensors that look at them (paper, sections 2.3, 3)."""
