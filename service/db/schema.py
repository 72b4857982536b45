"""The schema's version: bring a database to it, or tell whether it is there."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from sqlalchemy import Connection, Engine, inspect, text

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


class SchemaNotCurrent(RuntimeError):
    """The database has not the schema of this version.

    Attributes
    ----------
    what : str
        The end of a sentence that begins with the database: what it has, and what to do. It is for everybody,
        unlike the whole sentence, which says where the database is.
    """

    def __init__(self, engine: Engine, what: str) -> None:
        super().__init__(f"The database {engine.url.render_as_string(hide_password=True)} {what}")
        self.what = what


class ReferencesBroken(RuntimeError):
    """Rows of an SQLite database refer to rows that are not there, so that its schema was left as it was."""


@contextmanager
def stepping(engine: Engine) -> Iterator[Connection]:
    """Give a connection in one transaction in which a table may be rebuilt while others refer to it.

    Raises
    ------
    ReferencesBroken
        If a row refers to nothing after the steps (SQLite); everything is rolled back.

    Notes
    -----
    SQLite has no ALTER for most changes: Alembic copies the table and drops the old one, which its
    foreign keys forbid as soon as a row refers to it. The pragma does nothing inside a transaction,
    so it stands before BEGIN, and the check before the commit ("Making Other Kinds Of Table Schema
    Changes", sqlite.org/lang_altertable.html).
    """
    if engine.dialect.name != "sqlite":
        with engine.begin() as connection:
            yield connection
        return
    with engine.connect() as connection:
        driver: Any = connection.connection.dbapi_connection
        driver.execute("PRAGMA foreign_keys=OFF")
        try:
            with connection.begin():
                yield connection
                _check_references(connection)
        finally:
            driver.execute("PRAGMA foreign_keys=ON")


def _check_references(connection: Connection) -> None:
    broken = Counter(
        (row[0], row[2]) for row in connection.exec_driver_sql("PRAGMA foreign_key_check").fetchall()
    )
    if broken:
        told = ", ".join(
            f"{n} of {table} refer to {to} that are not there" for (table, to), n in broken.items()
        )
        raise ReferencesBroken(
            f"rows of the database refer to others that are gone, and nothing was changed: {told}; restore a"
            " backup, or repair these rows (PRAGMA foreign_key_check names them) and migrate again"
        )


def version(engine: Engine) -> str | None:
    """Return the schema's version that the database has; None where it has none yet."""
    return next(iter(_present(engine)), None)


def upgrade(engine: Engine, *, to: str = "head") -> None:
    """Bring the database to the schema of this version, in one transaction.

    Raises
    ------
    SchemaNotCurrent
        If the database has a schema that this version does not know.
    """
    from alembic import command  # noqa: PLC0415 - as above

    _require_known(engine)
    config = _config()
    with stepping(engine) as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, to)


def downgrade(engine: Engine, *, to: str) -> None:
    """Take the database back to an earlier schema, in one transaction."""
    from alembic import command  # noqa: PLC0415 - as above

    config = _config()
    with stepping(engine) as connection:
        config.attributes["connection"] = connection
        command.downgrade(config, to)


def is_current(engine: Engine) -> bool:
    """Return whether the database has exactly the schema of this version.

    Notes
    -----
    Reads Alembic's own table and compares it with the scripts' texts, without loading Alembic.
    """
    known, built_on = _scripts()
    return _present(engine) == known - built_on


def require_schema(engine: Engine) -> None:
    """Pass when the database has the schema of this version.

    Raises
    ------
    SchemaNotCurrent
        If it has not; the sentence tells what to do.
    SQLAlchemyError
        If it cannot be asked.
    """
    _require_known(engine)
    if not is_current(engine):
        raise SchemaNotCurrent(engine, "has not the schema of this version; run `groundplan migrate` first.")


def _require_known(engine: Engine) -> None:
    if strange := _present(engine) - _scripts()[0]:
        raise SchemaNotCurrent(
            engine,
            f"has the schema {', '.join(sorted(strange))} of a newer version of Groundplan, which this one"
            " does not know: start that version, or put back the backup that was made before it came.",
        )


def _present(engine: Engine) -> frozenset[str]:
    with engine.connect().execution_options(readonly=True) as connection:
        if not inspect(connection).has_table("alembic_version"):
            return frozenset()
        return frozenset(connection.execute(text("SELECT version_num FROM alembic_version")).scalars())


@cache
def _scripts() -> tuple[frozenset[str], frozenset[str]]:
    """Return the revisions that this version knows, and those of them that others build on."""
    made: dict[str, set[str]] = {"revision": set(), "down_revision": set()}
    for script in (resources.files("migrations") / "versions").iterdir():
        if script.name.endswith(".py"):
            for name, value in _REVISION.findall(script.read_text(encoding="utf-8")):
                made[name] |= set(_NAME.findall(value))
    return frozenset(made["revision"]), frozenset(made["down_revision"])
