"""What every blob store has to do, run against each store there is."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from service.domain.errors import ArtifactNotFound, StorageFull, UploadTooLarge
from service.storage.blobs import BlobStore, Stored
from service.storage.local import LocalBlobStore, full_disk_refused

STORES: dict[str, Callable[[Path], BlobStore]] = {"local": LocalBlobStore}
BYTES = b"wall " * 50_000
SHA256 = hashlib.sha256(BYTES).hexdigest()
LATER_S = 10_000.0


@pytest.fixture(params=sorted(STORES))
def store(request: pytest.FixtureRequest, tmp_path: Path) -> BlobStore:
    return STORES[request.param](tmp_path / "store")


def put(store: BlobStore, content: bytes = BYTES) -> Stored:
    with store.stage(max_bytes=len(content)) as staged:
        for start in range(0, len(content), 4096):
            staged.write(content[start : start + 4096])
        return staged.keep()


def files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.is_file() and p.name != ".lock")


def test_kept_bytes_are_found_under_their_sha256(store: BlobStore) -> None:
    assert put(store) == Stored(SHA256, len(BYTES))
    assert store.exists(SHA256)
    assert store.path(SHA256).read_bytes() == BYTES


def test_an_empty_file_is_a_blob_too(store: BlobStore) -> None:
    stored = put(store, b"")
    assert stored == Stored(hashlib.sha256(b"").hexdigest(), 0)
    assert store.path(stored.sha256).read_bytes() == b""


def test_the_same_bytes_twice_are_one_blob(store: BlobStore, tmp_path: Path) -> None:
    assert put(store) == put(store)
    assert files(tmp_path) == [store.path(SHA256)]


def test_the_same_bytes_at_the_same_time_are_one_blob(store: BlobStore, tmp_path: Path) -> None:
    barrier, kept = threading.Barrier(8), []

    def one() -> None:
        with store.stage(max_bytes=len(BYTES)) as staged:
            staged.write(BYTES)
            barrier.wait()
            kept.append(staged.keep())

    threads = [threading.Thread(target=one) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert kept == [Stored(SHA256, len(BYTES))] * 8
    assert files(tmp_path) == [store.path(SHA256)]
    assert store.path(SHA256).read_bytes() == BYTES


def test_what_is_not_kept_leaves_nothing(store: BlobStore, tmp_path: Path) -> None:
    with store.stage(max_bytes=100) as staged:
        staged.write(b"half")
        assert staged.size_bytes == 4
    with suppress(RuntimeError), store.stage(max_bytes=100) as staged:
        staged.write(b"half")
        raise RuntimeError
    assert files(tmp_path) == []


def test_a_byte_over_the_limit_is_refused_and_leaves_nothing(store: BlobStore, tmp_path: Path) -> None:
    with store.stage(max_bytes=10) as staged:
        staged.write(b"0123456789")
        with pytest.raises(UploadTooLarge) as refused:
            staged.write(b"x")
    assert refused.value.members == {"max_upload_bytes": 10}
    assert files(tmp_path) == []


def test_writing_after_keeping_is_a_defect(store: BlobStore) -> None:
    with store.stage(max_bytes=10) as staged:
        staged.write(b"a")
        staged.keep()
        with pytest.raises(ValueError, match="takes no more bytes"):
            staged.write(b"b")
        with pytest.raises(ValueError, match="kept once"):
            staged.keep()


def test_unknown_bytes_are_a_refusal_and_a_wrong_name_a_defect(store: BlobStore) -> None:
    assert not store.exists(SHA256)
    with pytest.raises(ArtifactNotFound):
        store.path(SHA256)
    for name in ("../../etc/passwd", SHA256.upper(), SHA256[:-1], ""):
        with pytest.raises(ValueError, match="64 small hexadecimal"):
            store.path(name)


def test_a_finished_file_is_adopted(store: BlobStore, tmp_path: Path) -> None:
    made = tmp_path / "made.bin"
    made.write_bytes(BYTES)
    assert store.adopt(made, keep_source=True) == Stored(SHA256, len(BYTES))
    assert made.read_bytes() == BYTES
    assert store.adopt(made) == Stored(SHA256, len(BYTES))
    assert not made.exists()
    assert files(tmp_path) == [store.path(SHA256)]


def test_a_file_on_another_file_system_is_adopted(store: BlobStore) -> None:
    other = Path("/dev/shm")  # noqa: S108 - any second file system
    if not other.is_dir() or other.stat().st_dev == store.path(put(store).sha256).stat().st_dev:
        pytest.skip("this machine has no second file system at /dev/shm")
    made = other / f"groundplan-{os.getpid()}"
    content = BYTES + b"elsewhere"
    made.write_bytes(content)
    stored = store.adopt(made)
    assert store.path(stored.sha256).read_bytes() == content
    assert not made.exists()


def test_staged_files_of_the_living_survive_the_sweep(store: BlobStore) -> None:
    with store.stage(max_bytes=len(BYTES)) as staged:
        staged.write(BYTES)
        assert store.sweep_staged(now_s=time.time() + LATER_S) == []
        assert staged.keep() == Stored(SHA256, len(BYTES))
    assert store.path(SHA256).read_bytes() == BYTES


def test_a_store_is_empty_until_its_first_blob(store: BlobStore) -> None:
    with store.stage(max_bytes=1) as staged:
        staged.write(b"x")
        assert store.is_empty()
    put(store)
    assert not store.is_empty()


def test_what_older_versions_left_in_their_folder_is_swept(tmp_path: Path) -> None:
    older = tmp_path / "tmp"
    older.mkdir()
    left = older / "0123"
    left.write_bytes(b"half")
    held = older / "4567"
    store = LocalBlobStore(tmp_path)
    with held.open("wb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert store.sweep_staged(now_s=time.time()) == []
        assert store.sweep_staged(now_s=time.time() + LATER_S) == [left]
    assert store.sweep_staged(now_s=time.time() + LATER_S) == [held]


def test_orphans_go_when_they_are_old_and_known_blobs_stay(store: BlobStore) -> None:
    known, orphan = put(store), put(store, b"orphan")
    is_known = {known.sha256}.__contains__
    assert store.sweep_orphans(is_known, now_s=time.time() + 60.0) == []
    assert store.sweep_orphans(is_known, now_s=time.time() + LATER_S) == [orphan.sha256]
    assert store.exists(known.sha256)
    assert not store.exists(orphan.sha256)


def test_an_old_orphan_that_is_stored_again_is_young(store: BlobStore) -> None:
    put(store)
    os.utime(store.path(SHA256), (0.0, 0.0))
    put(store)
    assert store.sweep_orphans(lambda _: False, now_s=time.time()) == []
    assert store.path(SHA256).read_bytes() == BYTES


_STORE_ONE = """
import sys
from pathlib import Path
from service import crash_points
from service.storage.local import LocalBlobStore
store = LocalBlobStore(Path(sys.argv[1]))
if sys.argv[2]:
    crash_points.arm(sys.argv[2])
with store.stage(max_bytes=10**9) as staged:
    staged.write(b"wall " * 50_000)
    staged.keep()
"""


@pytest.mark.parametrize("point", ["blob.before-fsync", "blob.before-rename", "blob.after-rename"])
def test_a_kill_at_any_point_leaves_a_whole_blob_or_none(tmp_path: Path, point: str) -> None:
    root = tmp_path / "store"
    ended = subprocess.run([sys.executable, "-c", _STORE_ONE, root, point], check=False)
    assert ended.returncode == -signal.SIGKILL
    store = LocalBlobStore(root)
    assert store.exists(SHA256) == (point == "blob.after-rename")
    swept = store.sweep_staged(now_s=time.time() + LATER_S)
    assert len(swept) == (0 if point == "blob.after-rename" else 1)
    put(store)
    assert files(root) == [store.path(SHA256)]
    assert store.path(SHA256).read_bytes() == BYTES


def test_a_file_size_limit_is_not_taken_for_a_full_disk(tmp_path: Path) -> None:
    store = LocalBlobStore(tmp_path / "store")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    try:
        with pytest.raises(OSError, match="too large") as raised, store.stage(max_bytes=10**6) as staged:
            staged.write(b"x" * 10_000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert raised.value.errno == errno.EFBIG
    assert files(tmp_path) == []


def test_a_full_disk_is_a_refusal_that_says_so() -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("this machine has no /dev/full")
    with pytest.raises(StorageFull) as refused, full_disk_refused(), full.open("wb", buffering=0) as device:
        device.write(b"x")
    assert refused.value.members == {"retry_after_s": 60}
