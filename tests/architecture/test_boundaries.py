"""What may stand where: imports, names of modules, sizes."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT, trees

DOMAIN_MAY_IMPORT = {"numpy", "service"} | sys.stdlib_module_names
NUMERICAL_STACK = (
    "scipy",
    "open3d",
    "numba",
    "cv2",
    "ezdxf",
    "pypdfium2",
    "skimage",
    "PIL",
    "shapely",
    "worker",
)
NO_PLACE = {"utils", "util", "helpers", "helper", "common", "misc", "shared", "tools", "stuff"}

STATEMENTS = {
    "exec_driver_sql",
    "execute",
    "order_by",
    "query",
    "scalar",
    "scalars",
    "stream_scalars",
    "where",
    "with_for_update",
}
"""The contract `sql-in-one-place` sees who imports SQLAlchemy; this, who is handed a query or a session."""

KNOW_NO_SESSION = ("service/db/", "worker/geometry/", "worker/formats/")
"""Where such names mean SQL and may, and where (contract `pure-geometry`) they mean trees of points."""

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 60
ROOMS = ("service", "worker", "migrations", "demo", "client", "tests")
LONG_FILES: dict[str, str] = {
    "client/groundplan_robot.py": "a robot takes the client as one file",
    "service/web/app/tests/told.ts": "written by `poe told`, read by tsc alone",
}
LONG_FUNCTIONS: dict[str, str] = {
    "migrations/versions/0001_the_first_tables.py:upgrade": "the first tables, one after the other",
    "tests/worker/test_service_crashes.py:request_for": "a table: the request that passes each crash point",
}
STORIES = ("tests/journeys/", "tests/browser/")
"""A test here is one story, told from beginning to end: its length is that of the story."""


def _run_python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_import_contracts_hold() -> None:
    command = [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_domain_imports_the_standard_library_and_numpy_alone() -> None:
    outside = {
        f"{path}: {module}"
        for path, tree in trees().items()
        if path.startswith("service/domain/")
        for module in _imported(tree)
        if module.split(".")[0] not in DOMAIN_MAY_IMPORT
    }
    assert outside == set()


def _imported(tree: ast.Module) -> list[str]:
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            found.append(node.module or "service")
    return found


def test_statements_are_made_and_run_in_service_db_alone() -> None:
    elsewhere = {
        f"{path}:{line}"
        for path, tree in trees().items()
        if not path.startswith(KNOW_NO_SESSION)
        for line in _statements(tree)
    }
    assert elsewhere == set()


@pytest.mark.parametrize(
    "code",
    [
        "session.query(Map)",
        "session.scalars(wanted)",
        "drawing_rows().where(Drawing.id == drawing_id)",
        "with kernel.db.reading() as session:\n    session.execute(wanted).all()",
    ],
)
def test_a_statement_elsewhere_would_be_found(code: str) -> None:
    assert len(_statements(ast.parse(code))) == 1
    assert _statements(ast.parse("np.where(a > 0, a, b); session.get_one(Map, map_id)")) == []


def _statements(tree: ast.Module) -> list[int]:
    """Return the lines that make or run a statement, `get` and `get_one` of one row by its key left out."""
    return [
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
        if node.func.attr in STATEMENTS and ast.unparse(node.func.value) != "np"
    ]


def test_the_service_loads_none_of_the_numerical_stack() -> None:
    loaded = set(_run_python("import service.app, sys; print(*sorted(sys.modules))").split())
    assert "fastapi" in loaded
    assert [name for name in NUMERICAL_STACK if name in loaded] == []


def test_the_worker_that_holds_the_lease_loads_no_job_code() -> None:
    loaded = set(_run_python("import worker.__main__, sys; print(*sorted(sys.modules))").split())
    assert "worker.runner" in loaded
    heavy = (
        "scipy",
        "open3d",
        "numba",
        "cv2",
        "skimage",
        "worker.child",
        "worker.registry",
        "worker.geometry",
    )
    assert [name for name in heavy if name in loaded] == []


def test_the_command_line_answers_help_without_the_numerical_stack() -> None:
    code = "import sys, worker.cli\ntry: worker.cli.main(['build', '--help'])\nexcept SystemExit: pass\n"
    listed = _run_python(code + "print('MODULES', *sorted(sys.modules))").split("MODULES")[1].split()
    assert [name for name in ("scipy", "open3d", "numba", "cv2", "skimage") if name in listed] == []


@pytest.mark.parametrize("room", ["service", "worker", "migrations", "demo", "tests"])
def test_no_module_has_a_name_without_a_place(room: str) -> None:
    paths = [path for path in (ROOT / room).rglob("*.py") if path.stem in NO_PLACE]
    paths += [path for path in (ROOT / room).rglob("*") if path.is_dir() and path.name in NO_PLACE]
    assert paths == []


def _sources(*suffixes: str) -> list[Path]:
    return [path for room in ROOMS for path in _below(ROOT / room) if path.suffix in suffixes]


def _below(folder: Path) -> Iterator[Path]:
    """Give the files below a folder, built and installed ones left out."""
    for path in folder.iterdir():
        if path.is_dir() and path.name not in {"dist", "node_modules", "__pycache__"}:
            yield from _below(path)
        elif path.is_file():
            yield path


def test_files_stay_readable() -> None:
    long = {
        path.relative_to(ROOT).as_posix()
        for path in _sources(".py", ".ts", ".tsx")
        if len(path.read_text().splitlines()) > MAX_FILE_LINES
    }
    assert long == set(LONG_FILES)


def test_functions_stay_readable() -> None:
    long = {
        f"{path.relative_to(ROOT)}:{node.name}"
        for path in _sources(".py")
        if not path.relative_to(ROOT).as_posix().startswith(STORIES)
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and _code_lines(node) > MAX_FUNCTION_LINES
    }
    assert long == set(LONG_FUNCTIONS)


def _code_lines(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines from `def` to the end, without the docstring."""
    assert node.end_lineno is not None
    lines = node.end_lineno - node.lineno + 1
    first = node.body[0]
    if ast.get_docstring(node) is not None and first.end_lineno is not None:
        lines -= first.end_lineno - first.lineno + 1
    return lines
