"""Windows of what is compressed: what a decoder has to allow for it."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.journeys.test_robot_client import client
from worker.formats.delta import write_delta
from worker.formats.package import write_coded

DOCS = Path(__file__).resolve().parents[2] / "docs" / "fleet.md"
COMMAND = "zstd -d --long=31 --patch-from=OLD.pcd DELTA -o NEW.pcd"
CODING_WINDOW_BYTES = 8 << 20
"""Largest window of the coding `zstd` (RFC 9659)."""


def window_bytes(frame: bytes) -> int:
    """Return the window that a frame's header asks for (RFC 8878, 3.1.1.1)."""
    assert frame[:4] == bytes.fromhex("28b52ffd")
    descriptor = frame[4]
    if not descriptor & 0x20:
        exponent, mantissa = frame[5] >> 3, frame[5] & 7
        base = 1 << (10 + exponent)
        return base + base // 8 * mantissa
    width = (1, 2, 4, 8)[descriptor >> 6]
    at = 5 + (0, 1, 2, 4)[descriptor & 3]
    return int.from_bytes(frame[at : at + width], "little") + (256 if width == 2 else 0)


@pytest.mark.parametrize(("old_bytes", "new_bytes"), [(10, 300_000), (300_000, 10), (3_000_000, 9_000_000)])
def test_a_delta_asks_for_a_window_of_the_new_file(tmp_path: Path, old_bytes: int, new_bytes: int) -> None:
    rng = np.random.default_rng(1)
    old, new, delta = (tmp_path / name for name in ("old", "new", "delta"))
    old.write_bytes(rng.bytes(old_bytes))
    new.write_bytes((old.read_bytes() + rng.bytes(new_bytes))[:new_bytes])
    write_delta(delta, old=old, new=new)
    assert window_bytes(delta.read_bytes()) == new_bytes


@pytest.mark.parametrize("size", [1000, 30_000_000])
def test_a_coded_file_asks_for_no_more_than_its_coding_allows(tmp_path: Path, size: int) -> None:
    path = tmp_path / "point-cloud.pcd"
    path.write_bytes(np.random.default_rng(1).bytes(size))
    assert 0 < window_bytes(write_coded(path).read_bytes()) <= CODING_WINDOW_BYTES


@pytest.mark.slow
@pytest.mark.parametrize("with_module", [True, False])
def test_a_cloud_that_grows_above_128_mib_is_decoded_as_documented(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, with_module: bool
) -> None:
    """Both ways of our client and the command of the documentation; zstd by its defaults refuses it."""
    rng = np.random.default_rng(1)
    old, new, delta, fresh = (tmp_path / name for name in ("OLD.pcd", "new", "DELTA", "NEW.pcd"))
    content = rng.bytes(1 << 20) * 133
    old.write_bytes(content)
    new.write_bytes(content[: 60 << 20] + rng.bytes(2 << 20) + content[60 << 20 :])
    write_delta(delta, old=old, new=new)
    assert f"`{COMMAND}`" in DOCS.read_text()
    subprocess.run(COMMAND.replace("-d ", "-dqf ").split(), cwd=tmp_path, check=True)
    assert fresh.read_bytes() == new.read_bytes()
    plain = COMMAND.replace("-d --long=31", "-dqf").split()
    refused = subprocess.run(plain, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert "too much memory" in refused.stderr
    fresh.unlink(missing_ok=True)
    if not with_module:
        monkeypatch.setattr(client, "find_zstd", lambda: shutil.which("zstd"))
    client.decode(old, delta, fresh)
    assert fresh.read_bytes() == new.read_bytes()
