"""Which tests `poe quick` runs for a change."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.quick.near import near
from tests.quick.run import changed_since

FILES = {
    "service/low.py": "",
    "service/high.py": "from service import low\n",
    "service/app/__init__.py": "import service.high\n",
    "tests/serving.py": "from service.app import run\n",
    "tests/unit/test_low.py": "from service.low import one\n",
    "tests/unit/test_alone.py": "import json\n",
    "tests/service/test_high.py": "from service.high import two\n",
    "tests/service/test_app.py": "from tests.serving import start\n",
    "tests/browser/test_page.py": "from tests.serving import start\n",
    "tests/architecture/test_documents.py": "PAGE = 'docs/page.md'\n",
    "docs/page.md": "",
}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("changed", "found"),
    [
        (
            ["service/low.py"],
            [
                (1, "tests/unit/test_low.py"),
                (2, "tests/service/test_high.py"),
                (4, "tests/service/test_app.py"),
            ],
        ),
        (["service/app/__init__.py"], [(2, "tests/service/test_app.py")]),
        (["tests/browser/test_page.py"], [(0, "tests/browser/test_page.py")]),
        (["docs/page.md"], [(1, "tests/architecture/test_documents.py")]),
        (["docs/other.md"], []),
    ],
)
def test_the_nearest_come_first_and_the_costly_only_where_they_changed(
    tree: Path, changed: list[str], found: list[tuple[int, str]]
) -> None:
    assert near(tree, changed) == found


def test_a_change_is_told_from_main_and_on_main_from_the_commit_before(tree: Path) -> None:
    def git(*words: str) -> None:
        who = ["-c", "user.name=t", "-c", "user.email=t@example.com"]
        subprocess.run(["git", *who, *words], cwd=tree, check=True, capture_output=True)

    git("init", "-b", "main")
    for name in ("docs/page.md", "service/low.py"):
        git("add", name)
        git("commit", "-m", name)
    git("add", ".")
    git("commit", "-m", "the rest")
    assert "service/high.py" in changed_since(tree, None)
    assert "service/low.py" not in changed_since(tree, None)
    git("checkout", "-b", "work")
    (tree / "service/low.py").write_text("one = 1\n")
    git("commit", "-am", "one")
    (tree / "service/new.py").write_text("")
    assert changed_since(tree, None) == ["service/low.py", "service/new.py"]
    assert "service/high.py" in changed_since(tree, "HEAD~2")
