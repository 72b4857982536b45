"""What is wrong with the robot's disk or with the way to it: noticed, mended, and no fault of a revision."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.journeys.proxies import Answer, on_files, page, proxied
from tests.journeys.robots import CLIENT, CLOUD, Plant, client, in_use, sha256
from tests.service.asking import ok

GRID, MANIFEST = "occupancy-grid.pgm", "manifest.json"
DONE = ["downloaded", "verified", "enabled"]


def flipped(content: bytes, at: int = -1) -> bytes:
    """Return the bytes with one bit of one of them changed."""
    changed = bytearray(content)
    changed[at] ^= 1
    return bytes(changed)


def spoil_file(path: Path, change: Callable[[bytes], bytes], *, unseen: bool = False) -> None:
    """Change a file; `unseen`: as a disk does that forgets, without a trace in the file system."""
    before = path.stat()
    with path.open("r+b") as file:
        changed = change(file.read())
        file.seek(0)
        file.truncate(len(changed))
        file.write(changed)
    if unseen:
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def is_whole(plant: Plant, robot: Any, n: int) -> bool:
    """Return whether the map in use is the revision's, in all files."""
    names = (CLOUD, MANIFEST, GRID)
    return all((robot.folder.current / name).read_bytes() == plant.files[n - 1][name] for name in names)


DAMAGES: dict[str, Callable[[Path], object]] = {
    "a bit": lambda path: spoil_file(path, lambda old: flipped(old, len(old) // 2)),
    "cut": lambda path: spoil_file(path, lambda old: old[:-1]),
    "longer": lambda path: spoil_file(path, lambda old: old + b"\0"),
    "empty": lambda path: spoil_file(path, lambda _old: b""),
    "gone": Path.unlink,
    "a folder": lambda path: (path.unlink(), path.mkdir()),
}


@pytest.mark.parametrize("name", [CLOUD, MANIFEST, GRID])
def test_a_damaged_map_is_noticed_and_fetched_again(plant: Plant, tmp_path: Path, name: str) -> None:
    robot = plant.robot(tmp_path / "robot", also=(GRID,))
    assert robot.run_once()
    assert is_whole(plant, robot, 1)
    for k, (what, damage) in enumerate(DAMAGES.items(), start=1):
        assert robot.run_once()
        assert len(plant.reports(robot)) == 3 * k, "nothing is done while the map is whole"
        damage(robot.folder.current / name)
        assert robot.run_once()
        assert is_whole(plant, robot, 1), what
        assert robot.folder.held()["way"] == ("whole" if name == CLOUD else "held")
        assert plant.reports(robot)[-3:] == [(1, state) for state in DONE]
    told = ok(plant.admin.get(f"/v1/robots/{robot.robot_id}/reports"))["items"][2]
    assert f"the map at hand was damaged: {name}" in told["detail"]
    seen = ok(plant.admin.get(f"/v1/robots/{robot.robot_id}"))
    assert (seen["progress"], seen["enabled_revision"]) == ("up-to-date", 1)


def test_what_the_file_system_does_not_tell_is_noticed_at_the_next_reading(
    plant: Plant, tmp_path: Path
) -> None:
    robot = plant.robot(tmp_path / "robot", also=(GRID,))
    assert robot.run_once()
    assert robot.run_once()
    spoil_file(robot.folder.current / CLOUD, flipped, unseen=True)
    assert robot.run_once()
    assert not is_whole(plant, robot, 1), "one reading in ten minutes"
    robot.folder = client.Folder(robot.folder.root, check_every_s=0.0)
    assert robot.run_once(), "a process that begins reads everything"
    assert is_whole(plant, robot, 1)
    assert robot.run_once()
    spoil_file(robot.folder.current / CLOUD, flipped, unseen=True)
    assert robot.run_once()
    assert is_whole(plant, robot, 1), "and so does one whose time has come"


def test_any_bit_of_the_folder_may_change_between_two_runs(plant: Plant, tmp_path: Path) -> None:
    """40 random bits (seed 1) in whatever file is there, each before a new run of the program."""
    robot, rng = plant.robot(tmp_path / "robot", also=(GRID,)), random.Random(1)
    assert robot.run_once()
    hit = set()
    for _ in range(40):
        found = [path for path in sorted(robot.folder.root.rglob("*")) if path.is_file()]
        small = [path for path in found if path.suffix == ".json"]
        path = rng.choice(rng.choice([found, small]))
        hit.add(path.name)
        at, bit = rng.randrange(path.stat().st_size), 1 << rng.randrange(8)
        spoil_file(path, lambda old: old[:at] + bytes([old[at] ^ bit]) + old[at + 1 :], unseen=True)  # noqa: B023
        robot.folder = client.Folder(robot.folder.root)
        assert robot.run_once(), path
        assert is_whole(plant, robot, 1), path
    assert hit >= {CLOUD, MANIFEST, "revision.json", "state.json"}
    assert "failed" not in {state for _, state in plant.reports(robot)}


def test_a_damaged_map_stays_in_use_until_the_service_is_there(plant: Plant, tmp_path: Path) -> None:
    robot = plant.robot(tmp_path / "robot")
    assert robot.run_once()
    spoil_file(robot.folder.current / CLOUD, flipped)
    robot.service.url, served = "http://127.0.0.1:9", robot.service.url
    with pytest.raises(client.Unreachable):
        robot.run_once()
    assert in_use(robot.folder.root) == sha256(flipped(plant.files[0][CLOUD]))
    robot.service.url = served
    assert robot.run_once()
    assert in_use(robot.folder.root) == sha256(plant.files[0][CLOUD])


def test_the_program_itself_notices_and_takes_what_was_not_wanted_before(
    plant: Plant, tmp_path: Path
) -> None:
    me, folder = plant.enrol(), tmp_path / "robot"
    command = [sys.executable, "-I", "-S", CLIENT, "--server", plant.server.url, "--map", plant.map_id]
    command += ["--robot", me["id"], "--folder", folder, "--once"]
    env = {"GROUNDPLAN_KEY": me["key"]}
    subprocess.run(command, env=env, check=True, capture_output=True)
    spoil_file(folder / "current" / CLOUD, flipped, unseen=True)
    done = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
    assert f"damaged and has to be fetched again: {CLOUD} has another SHA-256" in done.stderr
    assert in_use(folder) == sha256(plant.files[0][CLOUD])
    subprocess.run([*command, "--also", GRID], env=env, check=True, capture_output=True)
    assert (folder / "current" / GRID).read_bytes() == plant.files[0][GRID]


def _cached_wrong(_path: str, asked: Mapping[str, str], answer: Answer) -> Answer:
    is_past_caches = asked.get("Cache-Control") == "no-cache"
    return answer if is_past_caches else on_files(flipped)(_path, asked, answer)


def _only_files(spoil: Callable[[str, Mapping[str, str], Answer], Answer]) -> Any:
    return lambda path, asked, answer: (
        spoil(path, asked, answer) if "/artifacts/" in path or "/delta" in path else answer
    )


LOGIN = "<html><form action='/login'>Guest network</form></html>"
WAYLAY: dict[str, Callable[[str, Mapping[str, str], Answer], Answer]] = {
    "a byte of each file": on_files(flipped),
    "other bytes each time": on_files(lambda body: os.urandom(len(body))),
    "files end early": on_files(lambda body: body[: len(body) // 2]),
    "more before files": on_files(lambda body: b"\n" + body),
    "a login page": page(200, LOGIN),
    "a login page for files": _only_files(page(200, LOGIN)),
    "no entry": page(403, LOGIN),
    "no entry for files": _only_files(page(403, LOGIN)),
    "files are gone": _only_files(page(404, LOGIN)),
    "who are you": page(407, LOGIN),
    "no gateway": page(502, LOGIN),
    "JSON of its own": page(200, '{"ok": true, "artifacts": []}', **{"Content-Type": "application/json"}),
    "JSON that is no object": page(200, "[1]", **{"Content-Type": "application/json"}),
    "nothing new": page(304, ""),
    "no content": page(204, ""),
    "a login page elsewhere": page(302, "", Location="http://127.0.0.1:9/login"),
}


@pytest.mark.parametrize("kind", WAYLAY)
def test_a_bad_proxy_is_no_failed_revision(
    plant: Plant, tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "TRIES", 2)
    with proxied() as proxy:
        monkeypatch.setenv("http_proxy", proxy.url)
        robot = plant.robot(tmp_path / "robot")
        assert robot.run_once()
        stages = {"revision": 2, "stages": [{"share": 1.0}]}
        rollout = ok(plant.admin.post(f"/v1/maps/{plant.map_id}/rollouts", json=stages), 201)["id"]
        if kind == "nothing new":
            spoil_file(robot.folder.current / CLOUD, flipped)  # it knows better
        before, proxy.spoil = in_use(robot.folder.root), WAYLAY[kind]
        for _ in range(2):
            with pytest.raises(client.Unreachable):
                robot.run_once()
        assert in_use(robot.folder.root) == before
        assert all(url.startswith(plant.server.url) for url in proxy.seen), "the key goes nowhere else"
        proxy.spoil = lambda _path, _asked, answer: answer
        assert robot.run_once()
        assert in_use(robot.folder.root) == sha256(plant.files[1][CLOUD])
        assert list(robot.folder.parts.iterdir()) == []
    reports = plant.reports(robot)
    assert "failed" not in {state for _, state in reports}
    assert reports[:3] == [(1, state) for state in DONE]
    assert reports[-3:] == [(2, state) for state in DONE]
    assert ok(plant.admin.get(f"/v1/rollouts/{rollout}"))["state"] != "stopped"


def test_a_cache_that_holds_wrong_bytes_is_passed_by(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with proxied() as proxy:
        monkeypatch.setenv("http_proxy", proxy.url)
        robot = plant.robot(tmp_path / "robot")
        proxy.spoil = _cached_wrong
        assert robot.run_once()
    assert in_use(robot.folder.root) == sha256(plant.files[0][CLOUD])


def test_reports_wait_behind_a_bad_proxy_and_none_is_lost(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with proxied() as proxy:
        monkeypatch.setenv("http_proxy", proxy.url)
        robot = plant.robot(tmp_path / "robot")
        for kind in ("a login page", "no entry", "who are you", "no gateway", "no content", "nothing new"):
            bad = WAYLAY[kind]
            proxy.spoil = lambda path, asked, answer: (
                bad(path, asked, answer) if path.endswith("/reports") else answer  # noqa: B023
            )
            robot.run_once()
            assert len(robot.folder.state()["reports"]) == 3, kind
        proxy.spoil = lambda _path, _asked, answer: answer
        robot.run_once()
    assert plant.reports(robot) == [(1, state) for state in DONE]


def test_a_full_disk_of_the_robot_is_reported_as_a_failure(plant: Plant, tmp_path: Path) -> None:
    """What the robot itself cannot do is told of the revision, as before."""
    robot = plant.robot(tmp_path / "robot", ways=("whole",))
    assert robot.run_once()
    plant.publish(2)
    told = ok(plant.admin.get(f"/v1/maps/{plant.map_id}/published"))
    cloud = next(file for file in told["artifacts"] if file["path"] == CLOUD)
    (robot.folder.parts / cloud["sha256"]).symlink_to("/dev/full")
    with pytest.raises(client.NotDone, match="No space left"):
        robot.run_once()
    assert plant.reports(robot)[-1] == (2, "failed")
    shutil.rmtree(robot.folder.parts)
    robot.folder.parts.mkdir()
    assert robot.run_once()
    assert plant.reports(robot)[-1] == (2, "enabled")
