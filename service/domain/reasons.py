"""Why a verdict is what it is: a code that programs go by, what was measured, and a sentence for people."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from string import Formatter
from typing import Any

from service.domain.acceptance_table import SUPPORTS, TABLE
from service.domain.findings import Value
from service.domain.geojson import Geometry
from service.domain.measured import Measured

UNSPECIFIED = "unspecified"
"""The code of a reason that an earlier version told by a sentence alone, which none of today's is."""


@dataclass(frozen=True)
class Reason(Measured):
    """Hold one reason of a verdict.

    Parameters
    ----------
    code : str
        A row of the table of acceptance, or what an accepted pose rests on; `unspecified` of an earlier
        version's that is neither.
    values : mapping of str to number, str, or list of either
        The measures that the sentence shows, and the limit that one is beyond; a key carries its unit.
    where : Geometry, optional
        The place that it is about, in frame `map`.
    detail : str
        A sentence for people.
    """

    code: str
    values: Mapping[str, Value] = field(default_factory=dict)
    where: Geometry | None = None
    detail: str = ""

    @classmethod
    def upgraded(cls, value: Any) -> Any:
        """Return a stored reason; earlier versions told a sentence alone."""
        if isinstance(value, Mapping):
            return value
        return {"code": code_of(str(value)), "values": {}, "where": None, "detail": str(value)}


def code_of(sentence: str) -> str:
    """Return the code of the reason that says such a sentence."""
    found = (code for code, form in _forms() if form.fullmatch(sentence))
    return next(found, UNSPECIFIED)


def names_in(sentence: str) -> list[str]:
    """Return the measures that a sentence of the table names, in their order."""
    return [name for _, name, _, _ in Formatter().parse(sentence) if name is not None]


def kept_reasons(value: Sequence[Any] | None) -> list[dict[str, Any]]:
    """Return the reasons of a row of any version as JSON objects."""
    return [dict(Reason.upgraded(one)) for one in value or ()]


def _forms() -> list[tuple[str, re.Pattern[str]]]:
    rows = [(row.code, row.sentence) for row in TABLE if row.sentence]
    rows += [(one.code, one.sentence) for one in SUPPORTS]
    return [
        (code, re.compile("".join(_form(text, name) for text, name, _, _ in Formatter().parse(sentence))))
        for code, sentence in rows
    ]


def _form(text: str, name: str | None) -> str:
    return re.escape(text) + ("" if name is None else ".+")
