"""Change the numbers of a module one by one, and tell which changes no test notices.

``poe mutate`` does it to the limits of acceptance, ``poe mutate service/domain/gates.py`` to another module,
by the files of `tests/unit` that import it, or those that ``--tests`` names. Each number is multiplied with
0.8 and 1.25, in a copy of the tree. What has ended is kept in a ledger, so that a run goes on where it
stopped.
"""

from __future__ import annotations

import argparse
import ast
import importlib.util
import os
import random
import secrets
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.ledger import Ledger, digest_of
from tests.mutate.changes import FACTORS, Change, changed, changes_of

_ROOT = Path(__file__).resolve().parents[2]
_ACCEPTANCE = ("service/domain/acceptance_table.py", "service/domain/acceptance.py")
_NOT_COPIED = shutil.ignore_patterns(".*", "build", "node_modules", "__pycache__")
_SOURCES = ("service", "worker", "migrations", "tests", "uv.lock")


def unit_tests_of(root: Path, module: str) -> list[str]:
    """Return the files of `tests/unit` that import a module, all of them where none does."""
    name = module.removesuffix(".py").replace("/", ".")
    paths = sorted((root / "tests" / "unit").glob("test_*.py"))
    near = [path for path in paths if name in _imported(path)]
    return [path.relative_to(root).as_posix() for path in near or paths]


def _imported(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return found


@dataclass(frozen=True)
class Copy:
    """Run tests in a copy of the tree in which one module differs.

    Parameters
    ----------
    root : Path
        The copy.
    module : str
        The path of the module in it.
    tests : list of str
        What pytest is given.
    """

    root: Path
    module: str
    tests: list[str]

    def become(self, source: str) -> None:
        """Give the module another source."""
        path = self.root / self.module
        path.write_text(source, encoding="utf-8")
        # Python looks at whole seconds and the size to tell whether compiled code is of another source.
        Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)

    def passes(self, source: str, *, within_s: float | None = None) -> bool:
        """Return whether the tests pass, in time, with another source of the module."""
        self.become(source)
        command = [sys.executable, "-m", "pytest", "-qx", "-p", "pytest_timeout", "-p", "no:cacheprovider"]
        with tempfile.TemporaryDirectory(prefix="numba-", dir=self.root.parent) as compiled:
            # numba may have frozen a number of this module into what it compiled of another. Of plugins, that
            # which pyproject.toml needs is enough: the others take half of a short run.
            environment = {"NUMBA_CACHE_DIR": compiled, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
            tests = subprocess.Popen(
                [*command, *self.tests], cwd=self.root, env=os.environ | environment, start_new_session=True,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            try:
                return tests.wait(within_s) == 0
            except subprocess.TimeoutExpired:
                return False
            finally:
                if tests.poll() is None:  # with the processes that it started
                    os.killpg(tests.pid, signal.SIGKILL)
                    tests.wait()


def run(
    root: Path, module: str, changes: Iterable[Change], ledger: Ledger[Change], *,
    tests: list[str], until: float = float("inf"),
) -> None:  # fmt: skip
    """Write into the ledger whether the tests notice each change; what it holds is not run again.

    The tree at `root` is changed while it runs.
    """
    todo = [change for change in changes if change not in ledger.ended]
    if not todo or time.monotonic() > until:
        return
    source, began = (root / module).read_text(encoding="utf-8"), time.monotonic()
    copy = Copy(root, module, tests)
    if not copy.passes(source):
        sys.exit(f"{' '.join(tests)}: not all pass with {module} as it is: they tell nothing of changes.")
    within = 60.0 + 10.0 * (time.monotonic() - began)
    try:
        if copy.passes("raise RuntimeError\n"):
            sys.exit(f"{' '.join(tests)}: none loads {module}; name some that do with --tests.")
        for change in todo:
            if time.monotonic() > until:
                return
            ledger.write(change, {"survived": copy.passes(changed(source, change), within_s=within)})
    finally:
        copy.become(source)


def drawn(changes: list[Change], count: int, *, seed: int) -> list[Change]:
    """Return so many of the changes, the same for the same seed."""
    return sorted(random.Random(seed).sample(changes, min(count, len(changes))))


@contextmanager
def copied(root: Path) -> Iterator[Path]:
    """Give a copy of a tree's sources."""
    with tempfile.TemporaryDirectory(prefix="groundplan-mutate-") as folder:
        yield Path(shutil.copytree(root, Path(folder) / "tree", ignore=_NOT_COPIED))


def table(root: Path, changes: list[Change], ledger: Ledger[Change]) -> str:
    """Return a row for each module, and then each change that survived."""
    factors = "".join(f"{f'x{factor}':>8} {'survive':>8}" for factor in FACTORS)
    lines, survivors = [f"{'module':48}{factors} {'not run':>8}"], []
    for module in dict.fromkeys(change.module for change in changes):
        source = (root / module).read_text(encoding="utf-8").splitlines()
        of_it = [change for change in changes if change.module == module]
        ended = [change for change in of_it if change in ledger.ended]
        alive = [change for change in ended if ledger.ended[change]["survived"]]
        counts = "".join(
            f"{sum(c.factor == factor for c in ended):8} {sum(c.factor == factor for c in alive):8}"
            for factor in FACTORS
        )
        lines.append(f"{module:48}{counts} {len(of_it) - len(ended):8}")
        survivors += [
            f"{module}:{c.line}: {c.before} -> {c.after}   {source[c.line - 1].strip()}" for c in alive
        ]
    return "\n".join(lines + (["survivors:", *survivors] if survivors else []))


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("modules", nargs="*", default=_ACCEPTANCE, help="paths in this tree")
    parser.add_argument("--tests", nargs="+", help="what pytest is given instead")
    parser.add_argument("--draw", type=int, help="only so many changes, drawn by a seed")
    parser.add_argument("--seed", type=int, help="draw by this seed; it is drawn, and printed, if not given")
    parser.add_argument("--ledger", type=Path, default=_ROOT / "build" / "mutate.jsonl")
    parser.add_argument("--anew", action="store_true", help="forget what the ledger holds")
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so many")
    return parser.parse_args()


def main() -> int:
    """Change what is asked for, print the table, and return 0."""
    asked = _asked()
    if asked.anew:
        asked.ledger.unlink(missing_ok=True)
    until = time.monotonic() + 60.0 * asked.minutes
    with copied(_ROOT) as tree:
        changes = [c for module in asked.modules for c in changes_of((tree / module).read_text(), module)]
        if asked.draw is not None:
            seed = secrets.randbelow(1 << 32) if asked.seed is None else asked.seed
            print("seed:", seed, flush=True)
            changes = drawn(changes, asked.draw, seed=seed)
        word = " ".join(asked.tests or ["tests/unit"])
        ledger = Ledger(asked.ledger, Change, of=digest_of(*(tree / name for name in _SOURCES), word=word))
        for module in asked.modules:
            tests = asked.tests or unit_tests_of(tree, module)
            run(tree, module, [c for c in changes if c.module == module], ledger, tests=tests, until=until)
        print(table(tree, changes, ledger))
    return 0


if __name__ == "__main__":
    sys.exit(main())
