"""Rows for every table of whatever schema a database has, made from the tables: a new step is covered."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    DateTime,
    Engine,
    Float,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    inspect,
    select,
)

Rows = dict[str, list[dict[str, Any]]]

ROWS = 3
"""Rows of each table: enough that order and uniqueness matter; in the last, what may be null is."""

_CHECKED = re.compile(r"(\w+)\)?(?:::\w+(?: \w+)*)? (?:IN \(|= ANY \(+ARRAY\[)([^\])]*)")
_WORD = re.compile(r"'([^']+)'")
_FIRST = datetime(2026, 1, 2, 3, 4, 5, 678901, tzinfo=UTC)


def reflected(engine: Engine) -> MetaData:
    """Return our tables as the database has them; the job delivery's own are not ours."""
    found = MetaData()
    found.reflect(engine, only=lambda name, _: _is_ours(name))
    return found


def _is_ours(table: str) -> bool:
    return not table.startswith(("procrastinate_", "alembic_", "sqlite_"))


def fill(engine: Engine) -> Rows:
    """Put rows into every empty table, each of which refers to rows of the others, and return all rows."""
    found = reflected(engine)
    here = read(engine, found)
    allowed = {name: _allowed(engine, name) for name in found.tables}
    with engine.begin() as connection:
        for table in found.sorted_tables:
            if not here[table.name]:
                here[table.name] = [_row(table, here, allowed[table.name], number=k) for k in range(ROWS)]
                connection.execute(table.insert(), here[table.name])
    return read(engine, found)


def read(engine: Engine, found: MetaData | None = None) -> Rows:
    """Return the rows of our tables, each table's in the order of its primary key."""
    with engine.connect() as connection:
        return {
            name: [
                dict(row)
                for row in connection.execute(select(table).order_by(*table.primary_key.columns)).mappings()
            ]
            for name, table in (found or reflected(engine)).tables.items()
        }


def shape(engine: Engine) -> dict[str, Any]:
    """Return what the tables promise: columns, keys, checks, uniqueness and indexes, by table."""
    look, told = inspect(engine), {}
    for name in filter(_is_ours, look.get_table_names()):
        told[name] = {
            "columns": {c["name"]: (str(c["type"]), c["nullable"]) for c in look.get_columns(name)},
            "primary": look.get_pk_constraint(name)["constrained_columns"],
            "foreign": sorted(
                (k["constrained_columns"], k["referred_table"], k["referred_columns"])
                for k in look.get_foreign_keys(name)
            ),
            "unique": sorted(k["column_names"] for k in look.get_unique_constraints(name)),
            "checks": sorted(
                (str(k["name"]), sorted(_WORD.findall(k["sqltext"])))
                for k in look.get_check_constraints(name)
            ),
            "indexes": sorted(
                (str(k["name"]), k["column_names"], bool(k["unique"])) for k in look.get_indexes(name)
            ),
        }
    return told


def _row(table: Table, here: Rows, allowed: dict[str, list[str]], *, number: int) -> dict[str, Any]:
    row: dict[str, Any] = {}
    for column in table.columns:
        if column.nullable and number == ROWS - 1 and not column.primary_key:
            row[column.name] = None
        elif column.foreign_keys:
            to = next(iter(column.foreign_keys)).column
            row[column.name] = here[to.table.name][number][to.name] if here[to.table.name] else None
        elif column.name in allowed:
            row[column.name] = allowed[column.name][number % len(allowed[column.name])]
        else:
            row[column.name] = _value(table, column, number)
    return row


def _value(table: Table, column: Column[Any], number: int) -> object:
    kinds: list[tuple[type[Any], object]] = [
        (DateTime, _FIRST + timedelta(hours=number)),
        (JSON, {"number": number, "text": "床 \u00e4", "list": [None, 1.5, True]}),
        (Boolean, number % 2 == 0),
        (LargeBinary, bytes([0, 255, number])),
        (String, f"{table.name[:2]}-{number}"),
        (Integer, number + 1),
        (Float, number + 0.25),
    ]
    for kind, value in kinds:
        if isinstance(column.type, kind):
            return value
    raise TypeError(f"no value is known for {table.name}.{column.name}, a {column.type!r}")


def _allowed(engine: Engine, table: str) -> dict[str, list[str]]:
    """Return the words that checks allow, by column."""
    found: dict[str, list[str]] = {}
    for check in inspect(engine).get_check_constraints(table):
        for column, words in _CHECKED.findall(check["sqltext"]):
            found[column] = _WORD.findall(words)
    return found
