"""What a change can break, in a minute and a half: the checks that are quick, and the nearest tests.

``poe quick`` looks at what differs from the branch `main`, and where nothing does from the commit before;
``poe quick --since REVISION`` from another. The nearest tests come first; those for which no time is left are
skipped and counted, and so are files beyond the nearest two dozen. The whole suite stays what decides.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.quick.near import near

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 90.0
"""How long all may take."""
LAST_TEST_S = 15.0
"""Before the end of it no test is begun any more."""
MOST_FILES = 24
"""How many files of tests are loaded: more than the time suffices for, and few enough to be loaded soon."""
_UNTIL = "GROUNDPLAN_QUICK_UNTIL"
_WEB = "service/web/app/"


def changed_since(root: Path, revision: str | None) -> list[str]:
    """Return the paths of files that differ from a revision, those that git does not know yet included."""
    if revision is None:
        base = next(iter(_git(root, "merge-base", "HEAD", "main")), "HEAD")
        revision = base if _differ(root, base) else "HEAD~1"
    return _differ(root, revision)


def _differ(root: Path, revision: str) -> list[str]:
    told = _git(root, "diff", "--name-only", revision) + _git(root, "ls-files", "-o", "--exclude-standard")
    return sorted(set(told))


def _git(root: Path, *words: str) -> list[str]:
    done = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    return done.stdout.split("\n")[:-1] if done.returncode == 0 else []


def pytest_runtest_setup() -> None:
    """Skip a test for which no time is left."""
    if time.time() > float(os.environ.get(_UNTIL, "inf")):
        pytest.skip("no time left: the whole suite runs it")


def checks(changed: list[str]) -> list[list[str]]:
    """Return the commands of those checks that a change can break and that take seconds."""
    python = [path for path in changed if path.endswith(".py") and (ROOT / path).exists()]
    found = [["ruff", "format", "--check", *python], ["ruff", "check", *python]] if python else []
    if any(path.startswith(("service/", "worker/")) for path in python):
        found.append(["lint-imports", "--no-logo"])
    if any(path.startswith(_WEB) for path in changed):
        found.append([str(ROOT / "tools" / "build-dashboard"), "--check"])
    return found


def main() -> int:
    """Run the checks and the tests, and return 0 where all that was run passed."""
    begun = time.time()
    parser = argparse.ArgumentParser(prog="poe quick", description=__doc__)
    parser.add_argument("--since", metavar="REVISION", help="what the change is told from (default: main)")
    changed = changed_since(ROOT, parser.parse_args().since)
    found = [path for _, path in near(ROOT, changed)]
    taken = found[:MOST_FILES]
    print(f"{len(changed)} files changed; of {len(found)} files of tests the nearest {len(taken)} are run")
    failed = [
        words[0] for words in checks(changed) if subprocess.run(words, cwd=ROOT, check=False).returncode
    ]
    status = 0
    if taken:
        os.environ[_UNTIL] = str(begun + SECONDS - LAST_TEST_S)
        words = ["-q", "-n2", "--dist=loadfile", "--no-loadscope-reorder", "-p", "tests.quick.run", "-rfEs"]
        unwanted = "not benchmark and not crash and not full_disk and not vehicles"
        status = pytest.main([*words, "-m", unwanted, *taken])
    print(f"{time.time() - begun:.0f} s" + "".join(f"; {name} failed" for name in failed))
    return 1 if failed else int(status)


if __name__ == "__main__":
    sys.exit(main())
