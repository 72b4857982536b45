"""A client that a generator of others makes from the OpenAPI document: whole, and it works."""

from __future__ import annotations

import importlib
import inspect
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import httpx
import pytest

from tests.server import ROOT, Server
from tests.service.asking import a_map, a_ready_revision
from tests.service.by_hand import ByHand
from tests.service.snapshot import SNAPSHOT

DOCUMENT = json.loads(SNAPSHOT.read_text(encoding="utf-8"))
OPERATIONS = {
    operation["operationId"]: operation
    for methods in DOCUMENT["paths"].values()
    for operation in methods.values()
}


def _generate(document: str, folder: Path) -> str:
    """Return what the generator says of a document; the client lies in the folder then."""
    source = folder / "openapi.json"
    source.write_text(document, encoding="utf-8")
    options = [
        "--path",
        str(source),
        "--meta",
        "none",
        "--output-path",
        str(folder / "plant"),
        "--fail-on-warning",
    ]
    (folder / "config.yaml").write_text("post_hooks: []\n", encoding="utf-8")
    config = ["--config", str(folder / "config.yaml")]
    program = str(Path(sys.executable).with_name("openapi-python-client"))
    run = subprocess.run(
        [program, "generate", *options, *config], capture_output=True, text=True, check=False, cwd=ROOT
    )
    return f"{run.returncode}\n{run.stdout}{run.stderr}"


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("generated")
    said = _generate(SNAPSHOT.read_text(encoding="utf-8"), folder)
    assert said.startswith("0\n"), said
    assert "warning" not in said.lower(), said
    sys.path.insert(0, str(folder))
    yield folder / "plant"
    sys.path.remove(str(folder))
    for name in [name for name in sys.modules if name.partition(".")[0] == "plant"]:
        del sys.modules[name]


def _modules(generated: Path) -> dict[str, ModuleType]:
    """Return the module of every operation, imported."""
    places = [path.relative_to(generated.parent) for path in generated.glob("api/*/*.py")]
    named = [place.with_suffix("").parts for place in places if place.stem != "__init__"]
    return {parts[-1]: importlib.import_module(".".join(parts)) for parts in named}


def _speaks_json(operation: dict[str, Any]) -> bool:
    taken = operation.get("requestBody", {}).get("content", {})
    given = [content for status, answer in operation["responses"].items() if status[0] == "2"
             for content in answer.get("content", {})]  # fmt: skip
    return "application/json" in {*taken, *given}


def test_every_operation_is_kept_and_can_be_imported(generated: Path) -> None:
    modules = _modules(generated)
    assert set(modules) == set(OPERATIONS)
    speaking = {name for name, operation in OPERATIONS.items() if _speaks_json(operation)}
    assert len(speaking) > 60
    assert {name for name in speaking if not hasattr(modules[name], "sync")} == set()
    objects = [body for body in DOCUMENT["components"]["schemas"].values() if "properties" in body]
    schemas = {re.sub(r"\W|_", "", body["title"]).lower() for body in objects}
    models = {name.lower() for name in vars(importlib.import_module("plant.models"))}
    assert schemas - models == set()


def test_a_second_schema_of_one_title_would_be_noticed(tmp_path: Path) -> None:
    document = json.loads(SNAPSHOT.read_text(encoding="utf-8"))
    document["components"]["schemas"]["DrawingRegionIn"]["title"] = "RegionIn"
    assert "warning" in _generate(json.dumps(document), tmp_path).lower()


def test_the_generated_client_works(generated: Path, server: Server, by_hand: ByHand) -> None:
    models = importlib.import_module("plant.models")
    told = {"base_url": server.url, "token": server.admin_key, "raise_on_unexpected_status": True}
    with importlib.import_module("plant").AuthenticatedClient(**told) as client:
        call = {name: partial(module.sync, client=client) for name, module in _modules(generated).items()
                if hasattr(module, "sync")}  # fmt: skip
        made = call["create_map"](body=models.MapIn(site="Plant", name="generated"))
        assert made == call["get_map"](made.id)
        assert made.id in {row.id for row in call["list_maps"]().items}
        missing = call["get_map"]("map_none")
        assert (missing.status, missing.type_) == (404, f"{server.url}/problems/map-not-found")
        drawn = models.RevisionIn(drawing_id=by_hand.drawing(made.id))
        by_hand.build(call["create_revision"](made.id, body=drawn).job.id)
        pose = models.PlacementIn.from_dict({"rough_pose": {"x_m": 1.0, "y_m": 2.0}})
        asked = call["create_placement"](by_hand.scan(made.id), body=pose)
        by_hand.place(asked.job.id)
        corner = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]
        part = models.LayerPartIn.from_dict({"points": "all", "exclude": [{"within": corner}]})
        accepted = call["accept"](asked.placement.id, body=models.AcceptIn(part=part))
        assert (accepted.revision.n, accepted.revision.map_id) == (2, made.id)


def _arguments(call: Callable[..., Any]) -> list[Any] | None:
    """Return ids of nothing for an operation's path; None where it needs more than these."""
    given = []
    for name, parameter in inspect.signature(call).parameters.items():
        if parameter.kind is parameter.POSITIONAL_OR_KEYWORD:
            given.append(1 if parameter.annotation in (int, "int") else "none")
        elif parameter.default is parameter.empty and name != "client":
            return None
    return given


def test_every_operation_that_needs_no_body_is_called_and_its_answer_understood(
    generated: Path, server: Server, admin: httpx.Client, by_hand: ByHand
) -> None:
    a_ready_revision(admin, by_hand, a_map(admin))
    told = {"base_url": server.url, "token": server.admin_key, "raise_on_unexpected_status": True}
    called, found = set(), set()
    with importlib.import_module("plant").AuthenticatedClient(**told) as client:
        for name, module in _modules(generated).items():
            given = _arguments(module.sync_detailed)
            if given is None or _is_stream(OPERATIONS[name]) or not _speaks_json(OPERATIONS[name]):
                continue
            answer = module.sync_detailed(*given, client=client)
            assert answer.parsed is not None, (name, answer.status_code, answer.content[:200])
            assert type(answer.parsed).__name__ == "Problem" or answer.status_code < 300, name
            called.add(name)
            found |= {name} if answer.status_code < 300 else set()
    assert len(called) > 45, sorted(called)
    assert "accept" in called, "its body may be left out"
    assert {"list_maps", "list_jobs", "find_revisions", "find_drawings", "get_session"} <= found, sorted(
        found
    )


def _is_stream(operation: dict[str, Any]) -> bool:
    return "text/event-stream" in operation["responses"].get("200", {}).get("content", {})
