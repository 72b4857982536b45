"""The tree of refusals: its root and its branches."""

from __future__ import annotations

import re
from typing import Any, ClassVar


class DomainError(Exception):
    """Return a refusal that a caller can act on.

    Parameters
    ----------
    detail : str
        What was found and what to do, as a sentence for the person who asked.
    **members : object
        Machine-readable facts (JSON values), shown beside the sentence.
    """

    title: ClassVar[str] = "The request was refused"

    def __init__(self, detail: str, **members: Any) -> None:
        super().__init__(detail)
        self.detail = detail
        self.members = members

    @classmethod
    def slug(cls) -> str:
        """Return the stable name of this refusal, as it stands in the problem's ``type``."""
        return re.sub(r"(?<!^)(?=[A-Z])", "-", cls.__name__).lower()

    def problem(self) -> dict[str, Any]:
        """Return the refusal as the members of an RFC 9457 document, without type URL and status.

        The ``slug`` stands in for the type: the edge that knows the public address completes it.
        """
        return {"slug": self.slug(), "title": self.title, "detail": self.detail, **self.members}


class Denied(DomainError):
    """Who asks is unknown, or may not do this."""


class NotFound(DomainError):
    """The thing named does not exist, or not for this caller."""


class Conflict(DomainError):
    """The request is right in itself, but not in the present state."""


class Rejected(DomainError):
    """The input is wrong, and will be wrong the next time too."""


class Unfulfilled(DomainError):
    """The work was done and its result is not good enough."""


class Unavailable(DomainError):
    """Not now; the same call may succeed later."""
