"""Schemas made from the domain's dataclasses: name, kind and meaning of a member stand there alone.

`Kept[PlacementEvidence]` is the schema of that dataclass's JSON, as rows of this and of earlier versions
hold it; of what may be null, `Kept[RoughPose | None]`. What is read is never refused:

- A member that a row lacks, or has in a form that it no longer takes, is null where the dataclass is
  `Measured`; its default where it has one; and left out where the default is None or empty, since that says
  that nothing was said.
- A member that the dataclass does not name is left out.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Literal,
    TypeAlias,
    TypeVar,
    Union,
    get_args,
    get_origin,
)
from typing import get_type_hints as hints_of

import pydantic
from pydantic import ConfigDict, ValidationError, WrapValidator, create_model, model_validator

from service.api.schemas.base import JsonObject, Output
from service.domain.measured import Measured, as_json

T = TypeVar("T")

if TYPE_CHECKING:
    Kept: TypeAlias = Union[T, JsonObject]  # noqa: UP007 - of a variable no alias is made otherwise
else:

    class Kept:
        """Stand for the schema of a type of the domain; in a type checker, for the type or its JSON."""

        def __class_getitem__(cls, kind: Any) -> Any:
            form = _type_of(kind, hole=False)
            return Annotated[form, _NULL] if type(None) in get_args(kind) else form


_ENTRY = re.compile(r"(\w+(?:, \w+)*) : ")
_models: dict[type[Any], type[_Made]] = {}


class _Made(Output):
    """What every schema of this module is."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=True)


def meanings_of(kind: type[Any]) -> dict[str, str]:
    """Return what a dataclass's docstring says of its members, by their names."""
    told: dict[str, str] = {}
    names: list[str] = []
    for line in _section(inspect.getdoc(kind) or ""):
        if entry := _ENTRY.match(line):
            names = entry[1].split(", ")
        elif line.startswith(" "):
            for name in names:
                told[name] = _for_readers(f"{told.get(name, '')} {line.strip()}".strip())
    return told


def _for_readers(text: str) -> str:
    """Return a text of a docstring as one about JSON."""
    return re.sub(r"\bNone\b", "null", text.replace("``", "`"))


def _section(doc: str) -> Sequence[str]:
    """Return the lines that a numpydoc docstring has under Parameters."""
    _, _, rest = doc.partition("Parameters\n----------\n")
    return re.split(r"\n\w+\n-+\n", rest, maxsplit=1)[0].splitlines()


def _model_of(kind: type[Any]) -> type[_Made]:
    if kind not in _models:
        model = create_model(
            f"{kind.__name__}Out",
            __base__=_Made,
            __doc__=_title_of(kind),
            __validators__={"upgraded": _upgraded_as(kind)} if hasattr(kind, "upgraded") else {},
            **dict(_members_of(kind)),
        )
        _models[kind] = model
    return _models[kind]


def _upgraded_as(kind: Any) -> Any:
    def read(value: Any) -> Any:
        try:
            return kind.upgraded(value) if isinstance(value, Mapping | str) else value
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            msg = f"no version wrote this: {error}"
            raise ValueError(msg) from error

    return model_validator(mode="before")(read)


def _title_of(kind: type[Any]) -> str:
    first = " ".join((inspect.getdoc(kind) or "").partition("\n\n")[0].split()).removeprefix("Hold ")
    return _for_readers(first[:1].upper() + first[1:])


def _members_of(kind: type[Any]) -> Sequence[tuple[str, Any]]:
    """Return name, type and field of each member; a constant of the class, as `action`, tells kinds apart."""
    hints, told = hints_of(kind), meanings_of(kind)
    constants = [name for name, hint in hints.items() if get_origin(hint) is ClassVar]
    members: list[tuple[str, Any]] = [(name, Literal[getattr(kind, name)]) for name in constants]
    for field in fields(kind):
        nullable = issubclass(kind, Measured)
        members.append(
            (field.name, _member(field, hints[field.name], told.get(field.name), nullable=nullable))
        )
    return members


def _member(field: Field[Any], hint: Any, meaning: str | None, *, nullable: bool) -> Any:
    form = _type_of(hint, hole=nullable)
    default = field.default if field.default_factory is MISSING else field.default_factory()
    if default is MISSING:
        if not nullable:
            return form, pydantic.Field(description=meaning)
        return Annotated[form | None, _NULL], pydantic.Field(None, description=meaning)
    if default is None or default == ():
        read = WrapValidator(_or(lambda: _ABSENT))
        absent = pydantic.Field(default_factory=lambda: _ABSENT, exclude_if=_is_absent, description=meaning)
        return Annotated[form, read], absent
    value = _model_of(type(default)).model_validate(as_json(default)) if is_dataclass(default) else default
    return Annotated[form, WrapValidator(_or(lambda: value))], pydantic.Field(value, description=meaning)


_ABSENT: Any = object()


def _is_absent(value: object) -> bool:
    return value is _ABSENT


def _or(otherwise: Callable[[], Any]) -> Callable[[Any, Callable[[Any], Any]], Any]:
    def read(value: Any, handler: Callable[[Any], Any]) -> Any:
        try:
            return handler(value)
        except ValidationError:
            return otherwise()

    return read


_NULL = WrapValidator(_or(lambda: None))


def _type_of(hint: Any, *, hole: bool) -> Any:
    """Return a type of the domain as one of JSON.

    With `hole` the numbers of a sequence of any length may be null, as those that are not finite are.
    """
    origin, inner = get_origin(hint), get_args(hint)
    if hasattr(hint, "tolist"):
        return list[list[float]]
    if is_dataclass(hint) and isinstance(hint, type):
        return _model_of(hint)
    if origin in (Union, types.UnionType):
        return _union_of([one if one is type(None) else _type_of(one, hole=hole) for one in inner])
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return dict[str, _type_of(inner[1], hole=hole)]  # type: ignore[misc]  # made here
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return _list_of(inner, hole=hole, is_open=origin is not tuple or inner[-1] is Ellipsis)
    return hint


def _list_of(inner: Sequence[Any], *, hole: bool, is_open: bool) -> Any:
    if is_open:
        return list[_type_of(float | None if hole and inner[0] is float else inner[0], hole=hole)]  # type: ignore[misc]  # made here
    element = _union_of(list(dict.fromkeys(_type_of(one, hole=hole) for one in inner)))
    size = pydantic.Field(min_length=len(inner), max_length=len(inner))
    return Annotated[list[element], size]  # type: ignore[valid-type]  # made here


def _union_of(kinds: Sequence[Any]) -> Any:
    return Union[tuple(kinds)]  # noqa: UP007 - the kinds are known when it runs
