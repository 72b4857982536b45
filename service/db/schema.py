"""The schema's version: bring a database to it, or tell whether it is there."""

from __future__ import annotations

import re
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from sqlalchemy import Engine, inspect, text

if TYPE_CHECKING:
    from alembic.config import Config

_REVISION = re.compile(r"^(revision|down_revision)\b[^=]*=\s*(.+)$", re.MULTILINE)
_NAME = re.compile(r"[\"']([^\"']+)[\"']")


def _config() -> Config:
    from alembic.config import Config  # noqa: PLC0415 - a tenth of a second that only migrating costs

    config = Config()
    config.set_main_option("script_location", str(resources.files("migrations")))
    config.set_main_option("path_separator", "os")
    return config


def upgrade(engine: Engine, *, to: str = "head") -> None:
    """Bring the database to the schema of this version, in one transaction."""
    from alembic import command  # noqa: PLC0415 - as above

    config = _config()
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, to)


def downgrade(engine: Engine, *, to: str) -> None:
    """Take the database back to an earlier schema, in one transaction."""
    from alembic import command  # noqa: PLC0415 - as above

    config = _config()
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.downgrade(config, to)


def is_current(engine: Engine) -> bool:
    """Return whether the database has exactly the schema of this version.

    Notes
    -----
    Reads Alembic's own table and compares it with the scripts' texts, without loading Alembic.
    """
    with engine.connect() as connection:
        if not inspect(connection).has_table("alembic_version"):
            return False
        present = connection.execute(text("SELECT version_num FROM alembic_version")).scalars()
        return set(present) == _heads()


@cache
def _heads() -> frozenset[str]:
    """Return the revisions that no other script builds on."""
    made: dict[str, set[str]] = {"revision": set(), "down_revision": set()}
    for script in (resources.files("migrations") / "versions").iterdir():
        if script.name.endswith(".py"):
            for name, value in _REVISION.findall(script.read_text(encoding="utf-8")):
                made[name] |= set(_NAME.findall(value))
    return frozenset(made["revision"] - made["down_revision"])
