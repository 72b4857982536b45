"""Numbers are changed one by one; what no test notices is told, and nothing runs twice."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.ledger import Ledger, digest_of
from tests.mutate.changes import Change, changed, changes_of
from tests.mutate.run import drawn, run, table, unit_tests_of

ROOT = Path(__file__).resolve().parents[2]

LIMITS = '''\
"""Ten is named here, as 10.5, and changed nowhere."""

LONGEST_M = 2.0
FEWEST = 3
NONE_LESS, NOBODY_LOOKS_S = 0.0, 60.0


def fits(lengths: list[float]) -> bool:
    return lengths[0] <= LONGEST_M and len(lengths) >= FEWEST and lengths[1] >= NONE_LESS
'''
TEST = """\
from limits import fits


def test_fits():
    assert fits([1.9, 1.0, 1.0])
    assert not fits([2.1, 1.0, 1.0])
    assert not fits([1.9, 1.0])
"""


def test_every_number_is_changed_both_ways_and_whole_ones_stay_whole() -> None:
    found = [(c.line, c.before, c.after) for c in changes_of(LIMITS, "limits.py")]
    assert found == [
        (3, "2.0", "1.6"),
        (3, "2.0", "2.5"),
        (4, "3", "2"),
        (4, "3", "4"),
        (5, "60.0", "48.0"),
        (5, "60.0", "75.0"),
    ]
    others = [(c.before, c.after) for c in changes_of("a = -0.0005, 0, True, 100\nb: Literal[5] = 1", "b.py")]
    assert others == [
        ("0.0005", "0.0004"), ("0.0005", "0.000625"), ("0", "-1"), ("0", "1"), ("100", "80"), ("100", "125"),
        ("1", "0"), ("1", "2"),
    ]  # fmt: skip


def test_one_number_differs_in_a_changed_source() -> None:
    first = changes_of(LIMITS, "limits.py")[2]
    names: dict[str, object] = {}
    exec(changed(LIMITS, first), names)  # noqa: S102 - the source stands above
    assert (names["LONGEST_M"], names["FEWEST"], names["NOBODY_LOOKS_S"]) == (2.0, 2, 60.0)


def test_survivors_are_told_and_a_ledger_is_gone_on_with(tmp_path: Path) -> None:
    tree = tmp_path / "tree"
    tree.mkdir()
    (tree / "limits.py").write_text(LIMITS)
    (tree / "test_limits.py").write_text(TEST)
    changes = changes_of(LIMITS, "limits.py")

    def ledger() -> Ledger[Change]:
        return Ledger(tmp_path / "ledger.jsonl", Change, of=digest_of(tree, word=""))

    run(tree, "limits.py", changes[:3], ledger(), tests=["test_limits.py"])
    assert {c.after for c, said in ledger().ended.items() if said["survived"]} == set()
    run(tree, "limits.py", changes, ledger(), tests=["test_limits.py"])
    ended = {change: said["survived"] for change, said in ledger().ended.items()}
    assert ended == {change: change.before == "60.0" for change in changes}
    assert len((tmp_path / "ledger.jsonl").read_text().splitlines()) == len(changes)
    told = table(tree, changes, ledger()).splitlines()
    assert told[1].split() == ["limits.py", "3", "1", "3", "1", "0"]
    assert told[3:] == [
        "limits.py:5: 60.0 -> 48.0   NONE_LESS, NOBODY_LOOKS_S = 0.0, 60.0",
        "limits.py:5: 60.0 -> 75.0   NONE_LESS, NOBODY_LOOKS_S = 0.0, 60.0",
    ]
    assert (tree / "limits.py").read_text() == LIMITS
    (tree / "test_limits.py").write_text(TEST + "\n")
    assert ledger().ended == {}


@pytest.mark.parametrize(
    ("test", "told"),
    [("def test_nothing():\n    pass\n", "none loads"), ("def test_red():\n    assert 0\n", "not all pass")],
)
def test_tests_that_can_tell_nothing_are_refused(tmp_path: Path, test: str, told: str) -> None:
    tree = tmp_path / "tree"
    tree.mkdir()
    (tree / "limits.py").write_text(LIMITS)
    (tree / "test_limits.py").write_text(test)
    ledger = Ledger(tmp_path / "ledger.jsonl", Change, of="")
    with pytest.raises(SystemExit, match=told):
        run(tree, "limits.py", changes_of(LIMITS, "limits.py"), ledger, tests=["test_limits.py"])
    assert ledger.ended == {}


def test_a_seed_draws_the_same_changes() -> None:
    changes = changes_of("\n".join(f"a{k} = {k}.5" for k in range(100)), "a.py")
    assert drawn(changes, 20, seed=7) == drawn(changes, 20, seed=7) != drawn(changes, 20, seed=8)
    assert len(set(drawn(changes, 20, seed=7))) == 20
    assert drawn(changes, 1000, seed=7) == changes


def test_a_run_that_was_ended_tells_what_it_left(tmp_path: Path) -> None:
    command = [
        sys.executable, "-m", "tests.mutate.run", "service/domain/reading_cost.py", "--draw", "5",
        "--seed", "7", "--minutes", "0", "--ledger", str(tmp_path / "ledger.jsonl"),
    ]  # fmt: skip
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "seed: 7",
        f"{'module':48}    x0.8  survive   x1.25  survive  not run",
        f"{'service/domain/reading_cost.py':48}       0        0       0        0        5",
    ]


def test_the_tests_of_a_module_are_those_that_import_it(tmp_path: Path) -> None:
    unit = tmp_path / "tests" / "unit"
    unit.mkdir(parents=True)
    (unit / "test_a.py").write_text("from service.domain import gates\n")
    (unit / "test_b.py").write_text("import service.domain.recipe\nfrom service.domain.scale import Scale\n")
    assert unit_tests_of(tmp_path, "service/domain/gates.py") == ["tests/unit/test_a.py"]
    assert unit_tests_of(tmp_path, "service/domain/scale.py") == ["tests/unit/test_b.py"]
    assert unit_tests_of(tmp_path, "worker/child.py") == ["tests/unit/test_a.py", "tests/unit/test_b.py"]
