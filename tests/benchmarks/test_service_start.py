"""How long the service takes until it answers, and what it then holds."""

from __future__ import annotations

import sys
from pathlib import Path
from statistics import median

import pytest

from service.settings import Settings
from tests import web
from tests.server import running

MIB = 1024 * 1024


@pytest.mark.benchmark
def test_ready_and_at_rest(tmp_path: Path) -> None:
    ready, rss = [], []
    for number in range(5):
        with running(Settings(data_dir=tmp_path / str(number))) as server:
            assert web.get(server.url + "/readyz").status_code == 200
            ready.append(server.ready_after_s)
            rss.append(server.rss_bytes / MIB)
    spread = f"{min(ready):.2f} to {max(ready):.2f}"
    sys.stdout.write(f"\nready after {median(ready):.2f} s ({spread}), {max(rss):.0f} MiB at rest\n")
