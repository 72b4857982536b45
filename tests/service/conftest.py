"""Fixtures of the API's tests."""

from __future__ import annotations

import pytest

from tests.server import Server
from tests.service.by_hand import ByHand


@pytest.fixture(scope="module")
def by_hand(server: Server) -> ByHand:
    """Give the worker's part on the server's data, to be played by hand."""
    return ByHand(server.kernel)
