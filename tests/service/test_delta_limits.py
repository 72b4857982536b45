"""Which deltas a key may have made, and how many of a map wait to be made, on both databases."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from typing import Any

import httpx
import pytest
from sqlalchemy import func, select

from service.db.models import Job
from service.domain.lifecycle import MOST_WAITING_DELTAS
from tests.server import Server
from tests.service.asking import a_map, ok, refused
from tests.service.by_hand import ByHand
from tests.service.desks import served
from tests.service.halls import built_revision, make_delta


@pytest.fixture(scope="module", params=["sqlite", pytest.param("postgres", marks=pytest.mark.postgres)])
def server(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Give a service without a worker, on each database."""
    with served(request, tmp_path_factory.mktemp("deltas")) as given:
        yield given


@dataclass(frozen=True)
class Plant:
    """Hold a map with ready revisions 1 to n, none of them published."""

    server: Server
    map_id: str

    @property
    def admin(self) -> httpx.Client:
        """Return an admin's client."""
        return self.server.client(self.server.admin_key)

    @property
    def by_hand(self) -> ByHand:
        """Return the worker's part."""
        return ByHand(self.server.kernel)

    def where(self, old: int, new: int) -> str:
        """Return the path of the delta from one revision to another."""
        return f"/v1/maps/{self.map_id}/revisions/{new}/delta?from={old}"

    def publish(self, n: int, channel: str = "stable") -> None:
        """Let a channel point to a revision."""
        where = f"/v1/maps/{self.map_id}/revisions/{n}/publish"
        ok(self.admin.post(where, json={"channel": channel}))

    def key(self, role: str) -> httpx.Client:
        """Return a client with a new key that no robot has for its own."""
        made = ok(self.admin.post("/v1/keys", json={"name": role, "role": role}), 201)
        return self.server.client(made["key"])

    def robot(self, **more: Any) -> httpx.Client:
        """Return a client with the key of a new robot."""
        made = self.admin.post("/v1/robots", json={"name": "AMR", "map_id": self.map_id, **more})
        return self.server.client(ok(made, 201)["key"])

    def get_coded(self, client: httpx.Client, old: int, new: int) -> httpx.Response:
        """Return the answer to a request for a revision's cloud by who offers another's as a dictionary."""
        offer = base64.b64encode(hashlib.sha256(self.cloud(old)).digest()).decode()
        asking = {"Accept-Encoding": "dcz", "Available-Dictionary": f":{offer}:"}
        where = f"/v1/maps/{self.map_id}/revisions/{new}/artifacts/point-cloud.pcd"
        with client.stream("GET", where, headers=asking) as answer:
            answer._content = b"".join(answer.iter_raw())
        return answer

    def cloud(self, n: int) -> bytes:
        """Return the cloud of a revision; those of different maps differ."""
        return f"cloud {n} of {self.map_id} ".encode() * 20

    def jobs(self) -> int:
        """Return how many jobs the map has."""
        with self.server.kernel.db.reading() as session:
            of_map = select(func.count()).select_from(Job).where(Job.map_id == self.map_id)
            return session.scalar(of_map) or 0


def a_plant(server: Server, revisions: int) -> Plant:
    """Return a new map with so many ready revisions."""
    made = Plant(server, a_map(server.client(server.admin_key)))
    for n in range(1, revisions + 1):
        built_revision(made.admin, made.by_hand, made.map_id, {"point-cloud.pcd": made.cloud(n)})
    return made


@pytest.mark.parametrize("role", ["robot", "tablet"])
def test_what_no_robot_should_have_is_for_admins(server: Server, role: str, tmp_path: Path) -> None:
    plant = a_plant(server, 4)
    plant.publish(2, "stable")
    plant.publish(3, "beta")
    asker, before = plant.key(role), plant.jobs()
    for old, new in permutations(range(1, 5), 2):
        if new in {1, 4}:
            told = refused(asker.get(plant.where(old, new)), 409, "delta-not-offered")
            assert f"revision {new}" in told["detail"]
            whole = plant.get_coded(asker, old, new)
            assert (whole.status_code, whole.content) == (200, plant.cloud(new))
            assert "content-encoding" not in whole.headers
    assert plant.jobs() == before, "no job for what cannot be used"
    for old, new in ((1, 2), (4, 2), (1, 3)):
        refused(asker.get(plant.where(old, new)), 503, "delta-not-ready")
    assert plant.get_coded(asker, 2, 3).content == plant.cloud(3)
    assert plant.jobs() == before + 4
    job_id = refused(plant.admin.get(plant.where(1, 4)), 503, "delta-not-ready")["job_id"]
    assert refused(asker.get(plant.where(1, 4)), 503, "delta-not-ready")["job_id"] == job_id
    delta = make_delta(plant.by_hand, job_id, tmp_path)
    assert asker.get(plant.where(1, 4)).content == delta, "what is made is given to everybody"
    assert plant.get_coded(asker, 1, 4).headers["content-encoding"] == "dcz"


def test_a_robot_may_ask_for_what_a_rollout_gives_it(server: Server) -> None:
    plant = a_plant(server, 3)
    plant.publish(1)
    taken, other = plant.robot(group="first"), plant.robot()
    plan = {"revision": 2, "stages": [{"group": "first"}, {"share": 1.0}]}
    ok(plant.admin.post(f"/v1/maps/{plant.map_id}/rollouts", json=plan), 201)
    for robot in (other, plant.key("robot")):
        refused(robot.get(plant.where(1, 2)), 409, "delta-not-offered")
    refused(taken.get(plant.where(1, 3)), 409, "delta-not-offered")
    refused(taken.get(plant.where(1, 2)), 503, "delta-not-ready")
    refused(other.get(plant.where(1, 2)), 503, "delta-not-ready")
    elsewhere = a_plant(server, 2)
    refused(taken.get(elsewhere.where(1, 2)), 404, "map-not-found")


def test_so_many_wait_and_no_more(server: Server) -> None:
    most = MOST_WAITING_DELTAS
    plant = a_plant(server, most + 3)
    robots, last = [plant.robot() for _ in range(3)], most + 3
    plant.publish(last)
    begun = []
    for n in range(1, most + 1):
        answer = robots[n % 3].get(plant.where(n, last))
        begun.append(refused(answer, 503, "delta-not-ready")["job_id"])
    before = plant.jobs()
    for asker in (*robots, plant.admin):
        answer = asker.get(plant.where(most + 1, last))
        told = refused(answer, 503, "too-many-deltas")
        assert (told["max_waiting_deltas"], answer.headers["retry-after"]) == (most, "300")
        whole = plant.get_coded(asker, most + 1, last)
        assert (whole.status_code, whole.content) == (200, plant.cloud(last))
    assert plant.jobs() == before
    again = refused(robots[0].get(plant.where(1, last)), 503, "delta-not-ready")
    assert again["job_id"] == begun[0], "who asks for what waits is told so"
    elsewhere = a_plant(server, 2)
    elsewhere.publish(2)
    refused(elsewhere.robot().get(elsewhere.where(1, 2)), 503, "delta-not-ready")
    plant.by_hand.claim(begun[0])
    refused(robots[0].get(plant.where(most + 1, last)), 503, "too-many-deltas")
    plant.publish(most + 2)
    assert plant.jobs() == before + 1, "what the fleet will ask for is begun"
    ok(plant.admin.post(f"/v1/jobs/{begun[1]}/cancel"), 202)
    refused(robots[0].get(plant.where(most + 1, most + 2)), 503, "delta-not-ready")
    refused(robots[0].get(plant.where(most, most + 2)), 503, "too-many-deltas")


def test_many_who_ask_at_once_do_not_pass_the_limit(server: Server) -> None:
    most = MOST_WAITING_DELTAS
    plant = a_plant(server, most + 5)
    last = most + 5
    plant.publish(last)
    robot = plant.robot()

    def ask(n: int) -> str:
        slug: str = robot.get(plant.where(n, last)).json()["type"].rpartition("/")[2]
        return slug

    with ThreadPoolExecutor(8) as pool:
        told = list(pool.map(ask, range(1, last)))
    assert sorted(told) == ["delta-not-ready"] * most + ["too-many-deltas"] * 4


def test_a_channel_that_is_moved_to_and_fro_foresees_no_more(server: Server) -> None:
    plant = a_plant(server, 5)
    moves = list(permutations(range(1, 6), 2))
    assert len(moves) > MOST_WAITING_DELTAS
    before = plant.jobs()
    for k, (old, new) in enumerate(moves):
        plant.publish(old, f"channel-{k}")
        plant.publish(new, f"channel-{k}")
    assert plant.jobs() == before + MOST_WAITING_DELTAS
    refused(plant.robot().get(plant.where(*moves[-1])), 503, "delta-not-ready")
