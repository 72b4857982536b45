"""What the dashboard's types are checked against is what the service tells."""

from __future__ import annotations

from tests.formats.told import shape_of, told, written


def test_the_file_has_the_members_that_the_service_tells() -> None:
    assert shape_of(written()) == shape_of(told()), "what is told changed: run `poe told`, then `poe check`"
