"""Licences of what the product imports at run time, and that it imports what it asks for."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Iterable
from importlib.metadata import Distribution, distribution

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.architecture.sources import ROOT, trees

LISTED = {
    "certifi": "MPL-2.0: weak copyleft on its own files, which are certificates and unchanged",
    "orjson": "MPL-2.0, and Apache-2.0 or MIT: weak copyleft on its own files, unchanged",
    "tqdm": "MPL-2.0 and MIT: weak copyleft on its own files, unchanged; the OCR package asks for it",
    "paho-mqtt": "EPL-2.0 or BSD-3-Clause: taken under BSD-3-Clause",
    "psycopg": "LGPL-3.0: imported unchanged, and whoever installs it can replace it",
    "psycopg-binary": "LGPL-3.0: as psycopg",
    "psycopg-pool": "LGPL-3.0: as psycopg",
    "ifcopenshell": "LGPL-3.0-or-later: an extra, imported unchanged in a process of its own",
    "usd-core": "TOST-1.0: Apache-2.0 with another clause on trademarks",
}
"""Weak copyleft and odd licences, each with why it is no harm to a product under Apache-2.0."""

IMPORTED_BY_NAME = {
    "psycopg": "loaded by SQLAlchemy, when the database's URL names it: service/db/session.py",
    "rapidocr": "looked up first, since the extra may be absent: worker/formats/ocr.py",
}
MODULES = {
    "backports-zstd": "backports",
    "open3d-cpu": "open3d",
    "opencv-python-headless": "cv2",
    "paho-mqtt": "paho",
    "pillow": "PIL",
    "pycadkit": "cadkit",
    "python-neo-lzf": "lzf",
    "pyyaml": "yaml",
    "scikit-image": "skimage",
    "usd-core": "pxr",
}
"""The module that a distribution is imported as, where the names differ."""

_STRONG = re.compile(r"(?<!L)(?<!Lesser )\b(A?GPL|GNU (Affero )?General Public)", re.IGNORECASE)
_WEAK_OR_ODD = re.compile(
    r"LGPL|Lesser General|MPL|Mozilla|EPL|Eclipse|CDDL|EUPL|OSL|LicenseRef|TOST", re.IGNORECASE
)
_FREE = re.compile(r"MIT|BSD|Apache|PSF|Python Software|ISC|Zlib|HPND|Unlicense|0BSD", re.IGNORECASE)


def declared() -> list[Requirement]:
    """Return what the product asks for at run time, with all its extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras: dict[str, list[str]] = project["optional-dependencies"]
    texts = project["dependencies"] + [text for extra in extras.values() for text in extra]
    return [need for need in map(Requirement, texts) if need.marker is None or need.marker.evaluate()]


def closure() -> dict[str, Distribution]:
    """Return every distribution that these bring along on this machine, by name."""
    found: dict[str, Distribution] = {}
    open_needs = [(need, "") for need in declared()]
    seen = set()
    while open_needs:
        need, extra = open_needs.pop()
        asked = (canonicalize_name(need.name), frozenset(need.extras))
        if (need.marker is not None and not need.marker.evaluate({"extra": extra})) or asked in seen:
            continue
        seen.add(asked)
        found[asked[0]] = distribution(need.name)
        for text in found[asked[0]].requires or ():
            open_needs += [(Requirement(text), each) for each in ("", *need.extras)]
    return found


def licence(package: Distribution) -> str:
    """Return what a distribution says of its licence: an SPDX expression, else classifiers, else its text."""
    told = package.metadata.get_all
    classified = [text for text in told("Classifier") or () if text.startswith("License ::")]
    texts = [*(told("License-Expression") or ()), "; ".join(classified), *(told("License") or ())]
    return next((text[:200] for text in texts if text), "")


def strong(texts: Iterable[str]) -> list[str]:
    """Return those licences that would have to be the product's own, and no other choice is offered."""
    return [text for text in texts if _STRONG.search(text) and " OR " not in text]


def test_nothing_at_run_time_is_under_the_gpl() -> None:
    packages = closure()
    assert len(packages) > 40
    assert strong(f"{name}: {licence(package)}" for name, package in packages.items()) == []


@pytest.mark.parametrize(
    ("text", "is_strong"),
    [
        ("GPL-3.0-or-later", True),
        ("License :: OSI Approved :: GNU General Public License v3 (GPLv3)", True),
        ("AGPL-3.0", True),
        ("GNU Affero General Public License v3", True),
        ("LGPL-3.0-only", False),
        ("License :: OSI Approved :: GNU Lesser General Public License v3 (LGPLv3)", False),
        ("MIT OR GPL-2.0", False),
        ("MIT", False),
    ],
)
def test_a_strong_copyleft_is_seen(text: str, *, is_strong: bool) -> None:
    assert bool(strong([text])) is is_strong


def test_weak_and_odd_licences_are_listed_with_their_reason() -> None:
    told = {name: licence(package) for name, package in closure().items()}
    odd = {name for name, text in told.items() if _WEAK_OR_ODD.search(text) or not _FREE.search(text)}
    assert odd == set(LISTED), {name: told[name] for name in odd ^ set(LISTED) if name in told}


def test_what_is_asked_for_is_imported() -> None:
    imported = set(IMPORTED_BY_NAME)
    for node in (node for tree in trees().values() for node in ast.walk(tree)):
        if isinstance(node, ast.Import):
            imported |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            imported.add(node.module.split(".")[0])
    asked = {canonicalize_name(need.name) for need in declared()}
    assert {name for name in asked if MODULES.get(name, name.replace("-", "_")) not in imported} == set()
