"""What stands against publishing a revision: each gate is a sentence that a person can act on."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Gate:
    """Hold one thing that stands against publishing.

    Parameters
    ----------
    code : str
        `placement-not-accepted` or `finding-unresolved`.
    subject : str
        A layer or a drawing, by its id.
    message : str
        What was found, and what to do.
    reasons : sequence of mapping
        Of a placement's verdict, as `Reason.to_json` gives them.
    """

    code: str
    subject: str
    message: str
    reasons: Sequence[Mapping[str, Any]] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the gate as a JSON object."""
        return {
            "code": self.code,
            "subject": self.subject,
            "message": self.message,
            "reasons": list(self.reasons),
        }


@dataclass(frozen=True)
class JudgedLayer:
    """Hold a visible layer with the verdict that its placement was given."""

    layer_id: str
    name: str
    verdict: str
    reasons: Sequence[Mapping[str, Any]]


def closed_gates(
    layers: Iterable[JudgedLayer],
    *,
    drawing_id: str,
    findings: Iterable[Mapping[str, Any]],
) -> list[Gate]:
    """Return what stands against publishing; an empty list is a revision that may go out.

    Parameters
    ----------
    layers : iterable of JudgedLayer
        Those that the revision's files hold.
    findings : iterable of mapping
        What the drawing's reading remarked; only `serious` ones close a gate.
    """
    gates = [_not_accepted(layer) for layer in layers if layer.verdict != "accepted"]
    gates += [
        Gate("finding-unresolved", drawing_id, f"The drawing's reading says: {one.get('message', '')}")
        for one in findings
        if one.get("severity") == "serious"
    ]
    return gates


def _not_accepted(layer: JudgedLayer) -> Gate:
    told = f"The placement of the layer {layer.name!r} has the verdict {layer.verdict!r}"
    first = [str(reason.get("detail", "")) for reason in layer.reasons[:1]]
    return Gate("placement-not-accepted", layer.layer_id, ": ".join([told, *first]), layer.reasons)
