"""What tests stand on: a clock and randomness passed in, PostgreSQL, and no way out to a network."""

from __future__ import annotations

import ipaddress
import sys
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

pytest_plugins = ["tests.postgres", "tests.server", "tests.foreign.tus_js"]

ROOT = Path(__file__).resolve().parent.parent


class ManualClock:
    """Tell a time that passes only when a test says so."""

    def __init__(self, start: datetime) -> None:
        self._now = start

    def __call__(self) -> datetime:
        """Return the present."""
        return self._now

    def advance(self, seconds: float) -> None:
        """Let `seconds` pass."""
        self._now += timedelta(seconds=seconds)


def _only_loopback(event: str, args: tuple[object, ...]) -> None:
    if event not in {"socket.connect", "socket.sendto"}:
        return
    address = args[1]
    if not isinstance(address, tuple):  # a unix socket
        return
    host = str(address[0])
    if host == "localhost":
        return
    try:
        if ipaddress.ip_address(host).is_loopback or ipaddress.ip_address(host).is_unspecified:
            return
    except ValueError:
        pass
    msg = f"a test wanted to reach {host!r}: tests speak to this machine alone"
    raise PermissionError(msg)


def pytest_configure() -> None:
    """Close the network for this process (PEP 578 audit hook; a hook cannot be taken out again)."""
    sys.addaudithook(_only_loopback)


@pytest.fixture
def clock() -> ManualClock:
    """Give a clock that stands at noon of 2026-01-01 until it is advanced."""
    return ManualClock(datetime(2026, 1, 1, 12, tzinfo=UTC))


@pytest.fixture
def rng() -> np.random.Generator:
    """Give seeded randomness."""
    return np.random.default_rng(20_260_101)


@pytest.fixture
def entropy(rng: np.random.Generator) -> Callable[[int], bytes]:
    """Give seeded random bytes, where the product would draw secret ones."""
    return rng.bytes


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Give the folder of real inputs beside the repository; the test is skipped where there is none."""
    folder = ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("the real inputs are not part of the repository: ../shared/data is absent")
    return folder


@pytest.fixture(scope="session")
def shared_cases() -> Path:
    """Give the folder of collected cases beside the repository; the test is skipped where there is none."""
    folder = ROOT.parent / "shared" / "cases"
    if not folder.is_dir():
        pytest.skip("the collected cases are not part of the repository: ../shared/cases is absent")
    return folder
