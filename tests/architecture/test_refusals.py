"""The tree of refusals: each leaf is a public page."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from service.domain import errors
from service.domain.errors import DomainError
from tests.architecture.sources import names_used_outside

BRANCHES = ("Denied", "NotFound", "Conflict", "Rejected", "Unfulfilled", "Unavailable")


def _leaves(cls: type[DomainError] = DomainError) -> Iterator[type[DomainError]]:
    for child in cls.__subclasses__():
        if child.__subclasses__():
            yield from _leaves(child)
        elif child.__module__.startswith(f"{errors.__name__}."):
            yield child


LEAVES = sorted(_leaves(), key=lambda leaf: leaf.__name__)


def test_the_tree_has_the_six_branches() -> None:
    assert {child.__name__ for child in DomainError.__subclasses__()} == set(BRANCHES)
    assert [leaf.__name__ for leaf in LEAVES if leaf.__name__ in BRANCHES] == []


def test_every_slug_and_title_is_unique() -> None:
    assert len({leaf.slug() for leaf in LEAVES}) == len(LEAVES)
    assert len({leaf.title for leaf in LEAVES}) == len(LEAVES)


@pytest.mark.parametrize("leaf", LEAVES, ids=lambda leaf: leaf.slug())
def test_a_leaf_has_a_title_and_a_page(leaf: type[DomainError]) -> None:
    assert "title" in vars(leaf)
    assert not leaf.title.endswith(".")
    assert leaf.__doc__, "the docstring is the page"
    assert leaf.__doc__.splitlines()[0].endswith((".", ":"))
    assert not leaf.__name__.endswith("Error")


@pytest.mark.parametrize("leaf", LEAVES, ids=lambda leaf: leaf.slug())
def test_a_leaf_is_raised_somewhere(leaf: type[DomainError]) -> None:
    assert leaf.__name__ in names_used_outside("service/domain/errors/")
