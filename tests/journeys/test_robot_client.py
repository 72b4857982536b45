"""The robot's client against the real service: each way ends in the same cloud, whatever breaks."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from service.db.retention import forget_blobs, prune
from service.db.revisions import find_revision
from service.domain.lifecycle import MOST_WAITING_DELTAS
from service.settings import Settings
from tests.journeys.robots import CLIENT, CLOUD, Plant, a_plant, client, in_use, sha256
from tests.patience import PATIENCE_S
from tests.server import Server, start
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import ByHand
from tests.service.halls import built_revision

ZSTD = shutil.which("zstd")
FLEET = 200


@pytest.mark.parametrize("way", ["delta", "tiles", "whole"])
def test_each_way_ends_in_the_same_cloud(plant: Plant, tmp_path: Path, way: str) -> None:
    robot = plant.robot(tmp_path / "robot", ways=(way, "whole"), also=("occupancy-grid.pgm",))
    assert robot.run_once()
    assert in_use(tmp_path / "robot") == sha256(plant.files[0][CLOUD])
    plant.publish(2)
    assert robot.run_once()
    assert in_use(tmp_path / "robot") == sha256(plant.files[1][CLOUD])
    assert robot.folder.held()["way"] == way
    assert (robot.folder.current / "occupancy-grid.pgm").read_bytes() == plant.files[1]["occupancy-grid.pgm"]
    done = ["downloaded", "verified", "enabled"]
    assert plant.reports(robot) == [(n, state) for n in (1, 2) for state in done]
    seen = ok(plant.admin.get(f"/v1/robots/{robot.robot_id}"))
    assert (seen["progress"], seen["enabled_revision"]) == ("up-to-date", 2)
    assert robot.run_once()
    assert len(plant.reports(robot)) == 6
    plant.publish(1)
    assert robot.run_once()
    assert in_use(tmp_path / "robot") == sha256(plant.files[0][CLOUD])
    assert len(list(robot.folder.revisions.iterdir())) == 2
    assert list(robot.folder.parts.iterdir()) == []


@pytest.mark.parametrize("way", ["delta", "tiles"])
def test_the_standard_library_alone_will_do(plant: Plant, tmp_path: Path, way: str) -> None:
    """Run the file as a robot would, without any package; with the zstd program or without."""
    me, folder, programs = plant.enrol(), tmp_path / "robot", tmp_path / "programs"
    programs.mkdir()
    if way == "delta":
        assert ZSTD is not None
        (programs / "zstd").symlink_to(ZSTD)
    command = [sys.executable, "-I", "-S", CLIENT, "--server", plant.server.url, "--map", plant.map_id]
    command += ["--robot", me["id"], "--folder", folder, "--once"]
    bare = {"PATH": str(programs), "GROUNDPLAN_KEY": me["key"]}
    for n, files in enumerate(plant.files, start=1):
        plant.publish(n)
        done = subprocess.run(command, env=bare, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        assert in_use(folder) == sha256(files[CLOUD])
    assert f"revision 2 is in use ({way})" in done.stderr


@contextmanager
def cutting_proxy(url: str, *, cut_after: int, cuts: int) -> Iterator[str]:
    """Give an address that passes on to the service, and breaks the first answers off after some bytes."""
    target = urlsplit(url)
    listening = socket.create_server(("127.0.0.1", 0))
    left = [cuts]

    def pass_on(near: socket.socket) -> None:
        with near, socket.create_connection((target.hostname, target.port)) as far:
            far.sendall(near.recv(65536))
            passed = 0
            while chunk := far.recv(4096):
                near.sendall(chunk)
                passed += len(chunk)
                if passed > cut_after and left[0]:
                    left[0] -= 1
                    return

    def accept() -> None:
        while True:
            try:
                near, _ = listening.accept()
            except OSError:
                return
            threading.Thread(target=pass_on, args=(near,), daemon=True).start()

    thread = threading.Thread(target=accept)
    thread.start()
    try:
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
    finally:
        listening.shutdown(socket.SHUT_RDWR)
        listening.close()
        thread.join()


def test_a_broken_download_goes_on_where_it_ended(plant: Plant, tmp_path: Path) -> None:
    size = len(plant.files[0][CLOUD])
    with cutting_proxy(plant.server.url, cut_after=size // 3, cuts=2) as url:
        robot = plant.robot(tmp_path / "robot", url=url)
        told = ok(plant.admin.get(f"/v1/maps/{plant.map_id}/published"))
        files = {file["path"]: client.as_file(file) for file in told["artifacts"]}
        near = client.File(CLOUD, files[CLOUD].sha256, size, urlsplit(files[CLOUD].url).path)
        part = robot.folder.parts / near.sha256
        with pytest.raises(client.Unreachable):
            robot.download_rest(near, part)
        begun = part.stat().st_size
        assert 0 < begun < size
        os.truncate(part, begun - 1)
        with part.open("ab") as file:
            file.write(plant.files[0][CLOUD][begun - 1 : begun])
        robot.download(near)
    assert part.read_bytes() == plant.files[0][CLOUD]


def test_what_cannot_be_verified_never_comes_into_use(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "TRIES", 2)
    robot = plant.robot(tmp_path / "robot")
    assert robot.run_once()
    plant.publish(2)
    blobs, wrong = plant.server.kernel.blobs, plant.files[1][CLOUD]
    place = blobs.path(sha256(wrong))
    robot.ways = ("whole",)
    place.chmod(0o644)
    place.write_bytes(wrong[:-1] + bytes([wrong[-1] ^ 1]))
    with pytest.raises(client.Unreachable, match="another SHA-256"):
        robot.run_once()
    assert in_use(tmp_path / "robot") == sha256(plant.files[0][CLOUD])
    assert plant.reports(robot)[-1] == (1, "enabled"), "a robot cannot tell whose fault it is"
    seen = ok(plant.admin.get(f"/v1/robots/{robot.robot_id}"))
    assert (seen["progress"], seen["enabled_revision"]) == ("not-begun", 1)
    place.write_bytes(wrong)
    assert robot.run_once()
    assert in_use(tmp_path / "robot") == sha256(wrong)


def test_a_damaged_or_forgotten_map_is_fetched_whole(plant: Plant, tmp_path: Path) -> None:
    robot = plant.robot(tmp_path / "robot")
    assert robot.run_once()
    cloud = robot.folder.current / CLOUD
    cloud.chmod(0o644)
    cloud.write_bytes(cloud.read_bytes()[:-16] + bytes(16))
    plant.publish(2)
    assert robot.run_once()
    assert robot.folder.held()["way"] == "whole"
    told = robot.folder.held()
    client.write_whole(
        robot.folder.current / "revision.json", client.json.dumps({**told, "revision": 77}).encode()
    )
    plant.publish(1)
    robot.ways = ("delta", "whole")
    assert robot.run_once()
    assert in_use(tmp_path / "robot") == sha256(plant.files[0][CLOUD])
    assert robot.folder.held()["way"] == "whole"


def test_a_robot_that_holds_a_revision_long_let_go_takes_the_tiles(plant: Plant, tmp_path: Path) -> None:
    robot = plant.robot(tmp_path / "robot")
    assert robot.run_once()
    plant.publish(2)
    kernel = plant.server.kernel
    with kernel.db.writing("prune-revisions") as session:
        revision = find_revision(session, plant.map_id, n=1)
        assert revision is not None
        forget_blobs(session, prune(session, revision, now=kernel.now()))
    where = f"/v1/maps/{plant.map_id}/revisions/2"
    for asked in ("delta?from=1", "changes?since=1"):
        refused(plant.admin.get(f"{where}/{asked}"), 409, "revision-pruned")
    assert robot.run_once()
    assert robot.folder.held()["way"] == "tiles"
    assert in_use(tmp_path / "robot") == sha256(plant.files[1][CLOUD])


@pytest.mark.parametrize("refusal", ["delta-not-offered", "too-many-deltas"])
def test_a_robot_that_is_refused_the_delta_takes_the_whole_file(
    server: Server, tmp_path: Path, refusal: str
) -> None:
    """The channel has moved on since the robot's poll; or too many others have asked."""
    admin, by_hand = server.client(server.admin_key), ByHand(server.kernel)
    map_id = a_map(admin)
    clouds = [b"cloud %d of %s" % (n, map_id.encode()) * 99 for n in range(1, 3 + MOST_WAITING_DELTAS)]
    for cloud in clouds:
        built_revision(admin, by_hand, map_id, {CLOUD: cloud})
    plant = Plant(server, admin, map_id, ({CLOUD: clouds[0]}, {CLOUD: clouds[1]}))
    plant.publish(1)
    robot = plant.robot(tmp_path / "robot", ways=("delta", "whole"))
    assert robot.run_once()
    where = f"/v1/maps/{map_id}/revisions/2"
    if refusal == "too-many-deltas":
        for n in range(3, 3 + MOST_WAITING_DELTAS):
            refused(admin.get(f"{where}/delta?from={n}"), 503, "delta-not-ready")
        ok(admin.post(f"{where}/publish", json={"channel": "beta"}))
        robot.channel = "beta"
        assert robot.run_once()
    else:
        files = ok(admin.get(f"{where}/artifacts"))["items"]
        robot.update(2, {file["path"]: client.as_file(file) for file in files})
    with robot.service.open(f"{where}/delta?from=1") as answer:
        assert client.json.loads(answer.read())["type"].endswith(refusal)
    assert (robot.folder.held()["way"], in_use(tmp_path / "robot")) == ("whole", sha256(clouds[1]))


def test_whoever_opens_the_map_meanwhile_gets_one_or_the_other(plant: Plant, tmp_path: Path) -> None:
    robot = plant.robot(tmp_path / "robot", ways=("delta", "whole"))
    assert robot.run_once()
    known = {sha256(files[CLOUD]) for files in plant.files}
    seen: set[str] = set()
    ended = threading.Event()

    def read() -> None:
        while not ended.is_set():
            seen.add(in_use(tmp_path / "robot"))

    reader = threading.Thread(target=read)
    reader.start()
    try:
        for n in (2, 1, 2):
            plant.publish(n)
            assert robot.run_once()
    finally:
        ended.set()
        reader.join()
    assert seen <= known


def test_a_fleet_converges_while_the_service_is_killed_and_restarted(
    two_states: tuple[dict[str, bytes], dict[str, bytes]], tmp_path: Path
) -> None:
    settings = Settings(data_dir=tmp_path / "service")
    server = start(settings)
    try:
        plant = a_plant(server, two_states, tmp_path)
        first = plant.robot(tmp_path / "first", ways=("delta", "whole"))
        assert first.run_once()
        robots = [_copy_of(plant, first, tmp_path / f"robot-{k}") for k in range(FLEET)]
        plant.publish(2)
        with ThreadPoolExecutor(8) as pool:
            runs = [pool.submit(_until_done, robot) for robot in robots]
            for done in (FLEET // 5, FLEET // 2):
                while sum(run.done() for run in runs) < done:
                    time.sleep(0.05)
                server.stop(signal.SIGKILL)
                port, key = urlsplit(server.url).port, server.admin_key
                server.close()
                server = start(settings, admin_key=key, GROUNDPLAN_PORT=str(port))
            for run in runs:
                run.result(timeout=PATIENCE_S)
        wanted = sha256(two_states[1][CLOUD])
        assert {in_use(robot.folder.root) for robot in robots} == {wanted}
        admin = server.client(server.admin_key)
        asked = {"map": plant.map_id, "limit": 200}
        told = ok(admin.get("/v1/robots", params={**asked, "behind": False}))["items"]
        assert {robot.robot_id for robot in robots} <= {robot["id"] for robot in told}
        behind = ok(admin.get("/v1/robots", params={**asked, "behind": True}))["items"]
        assert {robot["id"] for robot in behind} <= {first.robot_id}
    finally:
        server.close()


def _copy_of(plant: Plant, first: Any, folder: Path) -> Any:
    """Return another robot that holds what the first one holds."""
    shutil.copytree(first.folder.root, folder, symlinks=True)
    (folder / "state.json").unlink()
    return plant.robot(folder, ways=("delta", "whole"))


def _until_done(robot: Any) -> None:
    """Let a robot poll until it runs revision 2 and has said so."""
    known = {robot.folder.held()["sha256"]}
    while robot.folder.state().get("revision") != 2 or robot.folder.state()["reports"]:
        with suppress(client.NotDone):
            robot.run_once()
        held = robot.folder.held()
        assert held is not None, "a torn map"
        known.add(held["sha256"])
        time.sleep(0.05)
    assert len(known) <= 2
