"""What long runs keep on disk of how each of their cases ended, so that they go on where they stopped."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Hashable
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any, Generic, TypeVar

Case = TypeVar("Case", bound=Hashable)


def digest_of(*roots: Path, word: str) -> str:
    """Return what names a word and the files (with their contents) at and under some paths."""
    digest = hashlib.sha256(word.encode())
    for root in roots:
        files = (path for path in (root, *root.rglob("*")) if path.is_file())
        for path in sorted(path for path in files if "__pycache__" not in path.parts):
            for part in (path.relative_to(root).as_posix().encode(), path.read_bytes()):
                digest.update(len(part).to_bytes(8, "big") + part)
    return digest.hexdigest()[:16]


class Ledger(Generic[Case]):
    """Keep how each case ended, a line of JSON each.

    Parameters
    ----------
    path : Path
        The file; it may hold lines of many runs.
    kind : type
        The frozen dataclass of the cases.
    of : str
        What the endings depend on beside the case (`digest_of`): lines of another are not looked at.
    """

    def __init__(self, path: Path, kind: type[Case], *, of: str) -> None:
        self._path, self._of = path, of
        self.ended: dict[Case, dict[str, Any]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        names = [member.name for member in fields(kind)]  # type: ignore[arg-type]
        if path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                said = json.loads(line)
                if said.pop("of", None) == of:
                    self.ended[kind(**{name: said.pop(name) for name in names})] = said

    def write(self, what: Case, said: dict[str, Any]) -> None:
        """Keep how a case ended."""
        self.ended[what] = said
        with self._path.open("a", encoding="utf-8") as ledger:
            ledger.write(json.dumps({"of": self._of} | asdict(what) | said) + "\n")  # type: ignore[call-overload]
