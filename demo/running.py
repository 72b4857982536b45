"""Starting and stopping `groundplan up`, as a person at a shell would."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx

from demo.console import DemoFailed

_STOP_S = 20.0


@dataclass(frozen=True)
class Running:
    """Hold where a service listens, its first admin key, and the process."""

    address: str
    admin_key: str
    process: subprocess.Popen[str]


@contextmanager
def groundplan_up(folder: Path, *, port: int = 0) -> Iterator[Running]:
    """Run service and worker on a new data folder until the block ends.

    Parameters
    ----------
    folder : Path
        Gets ``data/`` (which must not exist yet: the first admin key is printed only once) and
        ``groundplan.log``, all that the processes say.
    port : int
        0 takes a free one.

    Raises
    ------
    DemoFailed
        If there is data already, or the processes end before they name an address and a key.
    """
    data, log = folder / "data", folder / "groundplan.log"
    if data.exists():
        raise DemoFailed(f"{data} exists already: take a new folder, the demonstration starts from nothing")
    environment = os.environ | {
        "GROUNDPLAN_DATA_DIR": str(data),
        "GROUNDPLAN_PORT": str(port),
        "PYTHONUNBUFFERED": "1",
    }
    with log.open("w", encoding="utf-8") as sink:
        process = subprocess.Popen(
            [sys.executable, "-m", "worker.cli", "up"],
            env=environment,
            stdout=sink,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
    try:
        yield _announced(process, log)
    finally:
        _stop(process)


def _announced(process: subprocess.Popen[str], log: Path) -> Running:
    """Wait until the log names the address and the key and the service is ready."""
    while process.poll() is None:
        said = log.read_text(encoding="utf-8")
        address = re.search(r"http://[\w.\-]+:\d+", said)
        key = re.search(r"\bgp_[\w\-]+", said)
        if address and key and _is_ready(address.group()):
            return Running(address.group(), key.group(), process)
        time.sleep(0.05)
    last = "\n".join(log.read_text(encoding="utf-8").splitlines()[-15:])
    raise DemoFailed(f"groundplan up ended with status {process.returncode}; it said:\n{last}")


def _is_ready(address: str) -> bool:
    try:
        return httpx.get(f"{address}/readyz", timeout=5.0).status_code == 200
    except httpx.HTTPError:
        return False


def _stop(process: subprocess.Popen[str]) -> None:
    """End the process politely, and by force if it does not listen."""
    if process.poll() is not None:
        return
    process.terminate()
    try:
        process.wait(timeout=_STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
