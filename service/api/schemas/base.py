"""What all requests and answers share: strictness, text without control characters, pages, problems."""

from __future__ import annotations

from typing import Annotated, Any, Generic, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

T = TypeVar("T")


class Input(BaseModel):
    """A JSON body: a field that is not known is refused, and so is a number that is none."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, str_strip_whitespace=True)


class Output(BaseModel):
    """A JSON answer, read from a row or a value; its reader is built at the first one, not at the start."""

    model_config = ConfigDict(from_attributes=True, defer_build=True)


def _printable(value: str) -> str:
    if not value.isprintable():
        msg = "control characters are not allowed"
        raise ValueError(msg)
    return value


Text = Annotated[str, Field(min_length=1, max_length=200), AfterValidator(_printable)]
"""A name: 1 to 200 characters, none of them a control character."""

Remark = Annotated[str, Field(min_length=1, max_length=2000), AfterValidator(_printable)]
"""A sentence or a few of a person: 1 to 2000 characters, none of them a control character."""

Identifier = Annotated[str, Field(min_length=1, max_length=40, pattern=r"^[a-z]+_[0-9a-z]+$")]
"""An id as this service makes them: a prefix of its kind and 26 characters."""

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A JSON number; a string or a truth value is none."""


class Page(Output, Generic[T]):
    """One page of a list; `next_cursor` is null on the last."""

    items: list[T]
    next_cursor: str | None = Field(
        description="Send it as `cursor`, with the same filters, for the next page."
    )


def _absent(value: object) -> bool:
    return value is None


class Place(BaseModel):
    """Where a request is wrong: one of `pointer` (into the JSON body), `parameter` and `header`."""

    pointer: str | None = None
    parameter: str | None = None
    header: str | None = None
    detail: str


class Problem(BaseModel):
    """A problem document (RFC 9457); further members depend on the type."""

    model_config = ConfigDict(extra="allow", defer_build=True)

    type: str = Field(
        description="Address of the page that explains this problem.",
        examples=["http://127.0.0.1:8000/problems/map-not-found"],
    )
    title: str
    detail: str
    status: int | None = Field(
        None, exclude_if=_absent, description="HTTP status; absent where a job carries the problem."
    )
    errors: list[Place] | None = Field(None, exclude_if=_absent)


JsonObject = dict[str, Any]
