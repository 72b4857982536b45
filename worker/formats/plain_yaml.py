"""YAML from outside: plain values only, no aliases, no tags, bounded in size and depth."""

from __future__ import annotations

from typing import Any

import yaml

from service.domain.bounds import Bounds
from service.domain.errors import DrawingTooComplex, FileEmpty, FileMalformed

_DEEPEST = 32
_LONGEST_SCALAR = 8_192


def parse_plain_yaml(text: bytes, name: str, *, bounds: Bounds) -> dict[str, Any]:
    """Return the mapping that a YAML document holds.

    Robots' tools write no anchors and aliases; a file that does can unfold to more than any memory, and is
    refused before anything is made of it.

    Parameters
    ----------
    text : bytes
        All of the file.
    name : str
        What the file is called in a sentence.
    bounds : Bounds
        The most bytes and nodes that are read.

    Raises
    ------
    FileEmpty
        If there is nothing in it.
    DrawingTooComplex
        If it has more bytes, nodes or levels than are read.
    FileMalformed
        If it is no YAML, has an alias or a tag, or is no mapping.
    """
    if len(text) > bounds.max_yaml_bytes:
        raise DrawingTooComplex(
            f"{name} has {len(text)} bytes; at most {bounds.max_yaml_bytes} of YAML are read.",
            max_bytes=bounds.max_yaml_bytes,
        )
    if not text.strip():
        raise FileEmpty(f"{name} holds nothing.")
    try:
        _look_through(text, name, bounds)
        value = yaml.load(text, Loader=yaml.CSafeLoader)
    except yaml.YAMLError as error:
        raise FileMalformed(f"{name} is no plain YAML: {_first_line(error)}.") from error
    except (ValueError, OverflowError, RecursionError, AttributeError) as error:
        raise FileMalformed(f"{name} holds a value that cannot be read: {_first_line(error)}.") from error
    if not isinstance(value, dict):
        raise FileMalformed(f"{name} is no YAML mapping.")
    return value


def _look_through(text: bytes, name: str, bounds: Bounds) -> None:
    """Refuse a document by its events, which cost no memory."""
    nodes = depth = 0
    for event in yaml.parse(text, Loader=yaml.CSafeLoader):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
            line = _line(event)
            raise FileMalformed(
                f"{name} has an anchor or alias in line {line}; such files are not read, for they can unfold "
                "to more than any memory. Write the value out."
            )
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.ScalarEvent) and len(event.value) > _LONGEST_SCALAR:
            line = _line(event)
            raise FileMalformed(f"{name} has a value of {len(event.value)} characters in line {line}.")
        nodes += isinstance(event, yaml.NodeEvent)
        if nodes > bounds.max_yaml_nodes or depth > _DEEPEST:
            raise DrawingTooComplex(
                f"{name} has more than {bounds.max_yaml_nodes} values, or a depth of over {_DEEPEST}.",
                max_nodes=bounds.max_yaml_nodes,
            )


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]


def _line(event: yaml.Event) -> int:
    """Return the line in which an event begins, counted from 1."""
    return 1 if event.start_mark is None else event.start_mark.line + 1
