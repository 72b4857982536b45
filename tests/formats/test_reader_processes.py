"""What a reader in a process of its own has answered counts, however busy the machine is while it ends."""

from __future__ import annotations

import select
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex, FileMalformed, ReaderCrashed
from worker.formats import ifc_process, scan_process

ANSWER = '{"storey": "L1"}'
HEARD = Bounds(max_model_seconds=60.0)
LATE = Bounds(max_model_seconds=0.0)
NOTHING_MORE = "exec sleep 600 >&-"


@contextmanager
def kernel(script: str) -> Iterator[subprocess.Popen[bytes]]:
    """Give a process in the geometry kernel's place, once it has said something."""
    with subprocess.Popen(["sh", "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        select.select([child.stdout], [], [])
        try:
            yield child
        finally:
            child.kill()


def listen(child: subprocess.Popen[bytes], bounds: Bounds) -> object:
    return ifc_process._listen(child, {}, Path("m.ifc"), bounds, lambda _share: None)


@pytest.mark.parametrize("bounds", [HEARD, LATE], ids=["in time", "when time is over"])
@pytest.mark.parametrize("end", [NOTHING_MORE, "exit 0", "kill -SEGV $$"], ids=["idle", "ended", "crashed"])
def test_a_whole_answer_of_the_geometry_kernel_counts(bounds: Bounds, end: str) -> None:
    with kernel(f"echo '{ANSWER}'; {end}") as child:
        assert listen(child, bounds) == {"storey": "L1"}


def test_progress_alone_does_not_stop_the_clock() -> None:
    with kernel("while echo 'p 0.5'; do sleep 0.05; done") as child, pytest.raises(DrawingTooComplex):
        listen(child, LATE)


@pytest.mark.parametrize("script", ["printf '{\"sto'; kill -SEGV $$", "echo 'p 0.5'; exit 3"])
def test_an_answer_that_breaks_off_is_a_crash(script: str) -> None:
    with kernel(script) as child, pytest.raises(FileMalformed, match=r"signal 11|exit code 3"):
        listen(child, HEARD)


def test_a_kernel_that_closes_its_mouth_and_stays_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ifc_process, "_END_SECONDS", 0.1)
    with kernel(f"printf '{{'; {NOTHING_MORE}") as child, pytest.raises(FileMalformed, match="signal 9"):
        listen(child, HEARD)


@pytest.mark.parametrize(
    "end", ["exec sleep 600", "exit 0", "kill -SEGV $$"], ids=["idle", "ended", "crashed"]
)
def test_a_whole_answer_of_a_scan_s_reader_counts(end: str) -> None:
    assert scan_process._answer(["sh", "-c", f"echo '{ANSWER}'; {end}"], "las", seconds=3.0).decode() == (
        ANSWER + "\n"
    )


def test_a_scan_s_reader_that_says_nothing_is_late_or_has_crashed() -> None:
    with pytest.raises(FileMalformed, match="takes longer"):
        scan_process._answer(["sleep", "600"], Path("a.las"), seconds=0.2)
    with pytest.raises(ReaderCrashed, match=r"a\.las \(SIGSEGV\)"):
        scan_process._answer(["sh", "-c", "printf x; kill -SEGV $$"], Path("a.las"), seconds=60.0)
