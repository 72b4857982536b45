"""What is known of a hostile file: where it is uploaded to, and how it has to end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

READING = "reading"
"""What a file ends as that is read; any other end is the slug of its problem."""


@dataclass(frozen=True)
class Known:
    """Hold a file, the collection that it is uploaded to, and how it ends.

    Parameters
    ----------
    collection : str
        ``drawings`` or ``scans``.
    make : callable
        Returns the file.
    ends : str
        `READING`, or the slug of its problem.
    finding : str, optional
        Code of a finding that the reading has to have.
    """

    collection: str
    make: Callable[[], bytes]
    ends: str
    finding: str | None = None
