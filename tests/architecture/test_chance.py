"""Clock and randomness are passed in; tests replace nothing of ours."""

from __future__ import annotations

import ast

from tests.architecture.sources import ROOT, trees

ROOTS = {
    "service/app.py",
    "worker/__main__.py",
    "worker/child.py",
    "worker/vda5050/__main__.py",
}
"""Where parts are joined: the clock and the source of ids are taken here and passed on."""
OUT_OF_THE_AIR = {
    "service/api/edge.py": "the id of a request that has none, for the log alone",
    "service/storage/local.py": "the name of a file until it is complete",
}
CHANCE = {
    "date.today", "datetime.now", "datetime.today", "datetime.utcnow", "os.urandom", "time.time",
    "time.time_ns", "uuid.uuid1", "uuid.uuid4",
}  # fmt: skip
MODULES = ("secrets.", "random.", "np.random.")
SEEDED = {"np.random.default_rng", "np.random.Generator"}

REPLACED = {
    "tests/formats/test_delta.py": "what finds the program of zstd, by one that finds the system's",
    "tests/formats/test_for_people.py": "a writer, by one that fails: the fault is what is tested",
    "tests/formats/test_ply_body.py": "a limit",
    "tests/formats/test_reader_processes.py": "a patience",
    "tests/formats/test_usd_layers.py": "a limit",
    "tests/geometry/test_opening.py": "the width of a strip",
    "tests/journeys/test_robot_client.py": "a number of tries",
    "tests/journeys/test_robot_client_faults.py": "a number of tries",
}
"""What tests put in the place of a name of ours, and what it is."""


def _by_chance(tree: ast.Module) -> list[str]:
    """Return what takes the clock or randomness from the machine; a seed that is given is neither."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            name = ast.unparse(node)
            if name in CHANCE or (name.startswith(MODULES) and name not in SEEDED):
                found.append(name)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.random.default_rng" and not node.args:
            found.append("np.random.default_rng()")
    return found


def test_clock_and_randomness_are_taken_where_parts_are_joined() -> None:
    takers = {path for path, tree in trees().items() if _by_chance(tree)}
    assert takers == ROOTS | set(OUT_OF_THE_AIR)
    assert _by_chance(ast.parse("np.random.default_rng(); time.time(); f(datetime.now)")) != []
    assert _by_chance(ast.parse("np.random.default_rng(seed); time.monotonic()")) == []


def test_what_tests_replace_is_known() -> None:
    found = set()
    for path in (ROOT / "tests").rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if any(
            isinstance(n, ast.Attribute) and ast.unparse(n) == "monkeypatch.setattr" for n in ast.walk(tree)
        ):
            found.add(path.relative_to(ROOT).as_posix())
    assert found == set(REPLACED)
