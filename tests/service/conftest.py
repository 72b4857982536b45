"""Fixtures of the API's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.server import Server
from tests.service.by_hand import ByHand
from tests.service.desks import Desk, at_desk, served
from tests.service.plants import one_of_each


@pytest.fixture(scope="module")
def by_hand(server: Server) -> ByHand:
    """Give the worker's part on the server's data, to be played by hand."""
    return ByHand(server.kernel)


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def desk(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """Give a service with a worker, and a map to upload to, on each database."""
    with at_desk(request, tmp_path_factory.mktemp("desk")) as given:
        yield given


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def planted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Give a service without a worker that has one row of every kind, on each database."""
    with served(request, tmp_path_factory.mktemp("planted")) as server:
        one_of_each(server)
        yield server
