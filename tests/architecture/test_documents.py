"""The documents: links lead somewhere, decisions have their form, and no machine's path is in the sources."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from service.settings import Settings
from tests.architecture.sources import ROOT

DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
DECISIONS = sorted((ROOT / "docs" / "adr").glob("[0-9]*.md"))
LINK = re.compile(r"(?<!!)\[[^\]]*\]\(([^)\s]+)\)")
HEADINGS = ["Context", "Decision", "Consequences", "Enforced by"]


def _anchors(document: Path) -> set[str]:
    """Return the anchors of a document's headings, as forges make them."""
    titles = re.findall(r"^#+ +(.+?) *$", document.read_text(), flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_link_inside_the_repository_resolves(document: Path) -> None:
    broken = []
    for link in LINK.findall(document.read_text()):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (document.parent / name).resolve() if name else document
        if not target.exists() or (anchor and anchor not in _anchors(target)):
            broken.append(link)
    assert broken == []


@pytest.mark.parametrize("decision", DECISIONS, ids=lambda path: path.stem)
def test_a_decision_ends_with_what_enforces_it(decision: Path) -> None:
    assert re.findall(r"^## (.+)$", decision.read_text(), flags=re.MULTILINE) == HEADINGS


def test_decisions_are_numbered_without_a_gap() -> None:
    assert [int(path.name[:4]) for path in DECISIONS] == list(range(1, len(DECISIONS) + 1))


def test_the_commands_of_the_readme_exist() -> None:
    commands = set(re.findall(r"\btools/[\w-]+", (ROOT / "README.md").read_text()))
    assert {"tools/demo", "tools/test"} <= commands
    for command in commands:
        assert (ROOT / command).stat().st_mode & 0o111, command


def test_what_an_upgrade_needs_is_told_and_the_same_everywhere() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text()
    upgrading = changelog[changelog.index("### Upgrading") : changelog.index("### Added")]
    commands = re.findall(r"`(docker run [^`]+)`", upgrading)
    assert [command.rpartition(" -v groundplan_")[2].partition(":")[0] for command in commands] == [
        "blobs",
        "tls",
    ]
    operations = (ROOT / "docs" / "operations.md").read_text()
    assert all(f"`{command}`" in operations for command in commands)
    assert {"GROUNDPLAN_PUBLIC_URL", "GROUNDPLAN_TRUSTED_HOSTS"} <= set(
        re.findall(r"GROUNDPLAN_\w+", upgrading)
    )
    settings = {f"GROUNDPLAN_{name.upper()}" for name in Settings.model_fields}
    assert set(re.findall(r"GROUNDPLAN_\w+", changelog)) <= settings


def test_no_file_names_a_machine() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    pattern = re.compile(r"/(?:hom[e]|User[s]|wor[k]|roo[t])/\w")
    found = []
    for name in listed.stdout.split("\0"):
        path = ROOT / name
        if name and path.is_file() and path.suffix in {".py", ".md", ".toml", ".yml", ".yaml", ".sh", ""}:
            found += [name for line in path.read_text().splitlines() if pattern.search(line)]
    assert found == []


def test_the_settings_page_lists_every_setting_as_the_class_says_it() -> None:
    page = (ROOT / "docs" / "operations.md").read_text()
    rows = re.findall(r"^\| `(GROUNDPLAN_\w+)` \| (.*?) \| (.*) \|$", page, flags=re.MULTILINE)
    assert rows == settings_rows()


def settings_rows() -> list[tuple[str, str, str]]:
    """Return the rows of the table: name, default, meaning."""
    rows = []
    for name, setting in Settings.model_fields.items():
        default = "" if setting.default is None else f"`{setting.default}`"
        rows.append((f"GROUNDPLAN_{name.upper()}", default, str(setting.description)))
    return rows
