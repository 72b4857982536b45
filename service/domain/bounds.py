"""Limits on what is read from outside."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Bounds:
    """Hold the most that a reader takes of an untrusted file."""

    max_pixels: int = 200_000_000
    max_points: int = 50_000_000
    max_walls: int = 200_000
    max_map_points: int = 50_000_000
    max_strokes: int = 2_000_000
    max_texts: int = 100_000
    max_page_bytes: int = 128 << 20
    max_page_objects: int = 400_000
    max_model_bytes: int = 256 << 20
    max_model_memory_bytes: int = 2 << 30
    max_model_seconds: float = 240.0
    max_yaml_bytes: int = 8 << 20
    max_yaml_nodes: int = 400_000
    max_zip_bytes: int = 256 << 20
    max_dxf_bytes: int = 96 << 20
    max_dwg_memory_bytes: int = 1536 << 20
    max_dwg_seconds: int = 60
    max_scan_memory_bytes: int = 2 << 30
    max_scan_seconds: float = 120.0
