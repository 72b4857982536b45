"""A plant whose robots run our client."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.journeys.robots import Plant, a_plant
from tests.server import Server
from tests.service.halls import hall_files


@pytest.fixture(scope="session")
def two_states(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], dict[str, bytes]]:
    folder = tmp_path_factory.mktemp("halls")
    old, new = (hall_files(folder / str(x), machine_x=x) for x in (17.0, 19.5))
    return old, new


@pytest.fixture
def plant(server: Server, two_states: tuple[dict[str, bytes], dict[str, bytes]], tmp_path: Path) -> Plant:
    return a_plant(server, two_states, tmp_path)
