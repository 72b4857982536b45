"""How long a test waits for what must come: longer than a loaded machine needs, shorter than a test may take.

A process that ends is noticed at once; the seconds here only end a test that would hang. What has to be
quick is measured in benchmarks.
"""

from __future__ import annotations

PATIENCE_S = 240.0
