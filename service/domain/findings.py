"""Remarks about an input or a result: never a refusal, always with a stable code."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["info", "warning", "serious"]


@dataclass(frozen=True)
class Finding:
    """Hold one remark: a stable kebab-case `code`, a sentence, and machine-readable members."""

    code: str
    severity: Severity
    message: str
    members: dict[str, Any] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return the finding as a JSON object."""
        return {"code": self.code, "severity": self.severity, "message": self.message, **self.members}
