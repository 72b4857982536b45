"""Vector pages (PDF, SVG) to walls and their scale."""
