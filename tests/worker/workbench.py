"""A worker's surroundings for tests: a database, a folder, small drawings, and real worker processes."""

from __future__ import annotations

import os
import random
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw
from sqlalchemy import select

from service.db.blobs import record_blob
from service.db.jobs import enqueue
from service.db.models import Drawing, Job, Key, Map, Placement, Revision, Scan
from service.db.session import Database, open_engine
from service.domain.access import Actor
from service.domain.lifecycle import JobKind, JobState, Role
from service.domain.recipe import Recipe
from service.storage.local import LocalBlobStore
from service.usecases.compare import compare
from service.usecases.deltas import ask_for_delta
from service.usecases.kernel import Kernel
from service.usecases.rebuild import rebuild
from tests.forked import Forked, forked
from tests.patience import PATIENCE_S, soon
from tests.schemas import bring_to_head
from worker.formats.pcd import write_pcd
from worker.geometry.cloud.point_cloud import PointCloud

ROOT = Path(__file__).resolve().parents[2]


def a_small_drawing(path: Path, *, room_px: int = 120) -> Path:
    """Write a PNG of one room with a dividing wall, 5 cm a pixel."""
    image = Image.new("L", (room_px + 80, room_px + 60), 255)
    pen = ImageDraw.Draw(image)
    pen.rectangle((30, 30, 30 + room_px, 10 + room_px), outline=0, width=5)
    pen.line((30 + room_px // 2, 30, 30 + room_px // 2, 30 + room_px // 2), fill=0, width=5)
    image.save(path)
    return path


def a_slow_drawing(path: Path, *, strokes: int = 300) -> Path:
    """Write a sheet full of strokes; 300 take about a second to read, 6,000 many."""
    rng = np.random.default_rng(3)
    side = round(800 * max(1.0, strokes / 170) ** 0.5)
    sheet = np.full((side, side), 255, dtype=np.uint8)
    for x, y, length in rng.integers(0, side - 100, (strokes, 3)):
        sheet[y : y + 3, x : x + length % 300] = 0
        sheet[y : y + length % 300, x : x + 3] = 0
    Image.fromarray(sheet).save(path)
    return path


def a_small_scan(path: Path) -> Path:
    """Write a PCD of the walls of `a_small_drawing`'s room, 2.5 m high, in the map's own frame."""
    along, up = np.arange(0.0, 1.0, 0.01), np.arange(0.05, 2.5, 0.1)
    left, right, low, high, middle = 1.6, 7.4, 2.6, 7.4, 4.4
    corners = [
        ((left, low), (right, low)),
        ((right, low), (right, high)),
        ((right, high), (left, high)),
        ((left, high), (left, low)),
        ((middle, high), (middle, 4.6)),
    ]
    lines = [np.add(a, np.outer(along, np.subtract(b, a))) for a, b in corners]
    xy = np.vstack(lines)
    points = np.column_stack([np.repeat(xy, len(up), axis=0), np.tile(up, len(xy))])
    write_pcd(path, PointCloud.of(points))
    return path


@dataclass
class Workbench:
    """Hold the installation that a test's worker works on."""

    data_dir: Path
    url: str
    seed: int = 7
    environment: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        entropy = random.Random(self.seed)
        self.data_dir.mkdir(parents=True, exist_ok=True)
        self.kernel = Kernel(
            db=Database(open_engine(self.url)),
            blobs=LocalBlobStore(self.data_dir),
            now=lambda: datetime.now(UTC),
            entropy=entropy.randbytes,
        )

    def prepare(self) -> None:
        """Make the tables where they are not there, one key and one map."""
        bring_to_head(self.kernel.db)
        now = self.kernel.now()
        with self.kernel.db.writing("receive-drawing") as session:
            self.key_id, self.map_id = self.kernel.new_id("key"), self.kernel.new_id("map")
            session.add(Key(id=self.key_id, name="test", role="admin", digest=self.key_id, created_at=now))
            session.add(Map(id=self.map_id, site="works", name=self.map_id, created_at=now, updated_at=now))

    @contextmanager
    def another(self, *, key: bool = True, a_map: bool = True) -> Iterator[None]:
        """Let what is asked for within come from another key, for another map, or both."""
        before = self.key_id, self.map_id
        self.prepare()
        self.key_id = self.key_id if key else before[0]
        self.map_id = self.map_id if a_map else before[1]
        try:
            yield
        finally:
            self.key_id, self.map_id = before

    def add_drawing(self, path: Path, *, metres_per_px: float = 0.05) -> str:
        """Return the job that reads a drawing: received as an upload is."""
        stored = self.kernel.blobs.adopt(path, keep_source=True)
        now = self.kernel.now()
        drawing_id, job_id = self.kernel.new_id("drw"), self.kernel.new_id("job")
        with self.kernel.db.writing("receive-drawing") as session:
            record_blob(session, stored.sha256, size_bytes=stored.size_bytes, media_type="image/png", now=now)
            enqueue(
                session,
                JobKind.READ_DRAWING,
                job_id=job_id,
                map_id=self.map_id,
                subject_id=drawing_id,
                key_id=self.key_id,
                now=now,
            )
            session.add(
                Drawing(
                    id=drawing_id,
                    map_id=self.map_id,
                    file_name=path.name,
                    blob_sha256=stored.sha256,
                    options={"page": 1, "scale": {"metres_per_unit": metres_per_px}},
                    job_id=job_id,
                    created_at=now,
                    created_by=self.key_id,
                )
            )
        return job_id

    def add_scan(self, path: Path) -> str:
        """Return the job that reads a scan."""
        stored = self.kernel.blobs.adopt(path, keep_source=True)
        now = self.kernel.now()
        scan_id, job_id = self.kernel.new_id("scn"), self.kernel.new_id("job")
        with self.kernel.db.writing("receive-scan") as session:
            record_blob(
                session,
                stored.sha256,
                size_bytes=stored.size_bytes,
                media_type="application/octet-stream",
                now=now,
            )
            enqueue(
                session,
                JobKind.READ_SCAN,
                job_id=job_id,
                map_id=self.map_id,
                subject_id=scan_id,
                key_id=self.key_id,
                now=now,
            )
            session.add(
                Scan(
                    id=scan_id,
                    map_id=self.map_id,
                    file_name=path.name,
                    blob_sha256=stored.sha256,
                    job_id=job_id,
                    created_at=now,
                    created_by=self.key_id,
                )
            )
        return job_id

    def add_placement(self, scan_job_id: str, *, revision_n: int) -> str:
        """Return the job that places a scan on a revision, from the truth."""
        now = self.kernel.now()
        placement_id, job_id = self.kernel.new_id("plc"), self.kernel.new_id("job")
        with self.kernel.db.writing("place-scan") as session:
            scan = session.scalars(select(Scan).where(Scan.job_id == scan_job_id)).one()
            enqueue(
                session,
                JobKind.PLACE_SCAN,
                job_id=job_id,
                map_id=self.map_id,
                subject_id=placement_id,
                key_id=self.key_id,
                now=now,
            )
            session.add(
                Placement(
                    id=placement_id,
                    map_id=self.map_id,
                    scan_id=scan.id,
                    revision_n=revision_n,
                    job_id=job_id,
                    initial_pose={"x_m": 0.0, "y_m": 0.0, "z_m": 0.0, "yaw_rad": 0.0},
                    ndt_resolution_m=1.0,
                    created_at=now,
                    created_by=self.key_id,
                )
            )
        return job_id

    def order_crash(self, point: str) -> None:
        """Let the next process that passes the point kill itself."""
        order = self.data_dir / "crash-at"
        order.with_suffix(".new").write_text(point, encoding="ascii")
        order.with_suffix(".new").replace(order)

    @property
    def has_crashed(self) -> bool:
        """Return whether the order was carried out."""
        return not (self.data_dir / "crash-at").exists()

    def add_revision(self, drawing_job_id: str, **recipe: Any) -> str:
        """Return the job that builds the next revision from a drawing."""
        now = self.kernel.now()
        revision_id, job_id = self.kernel.new_id("rev"), self.kernel.new_id("job")
        with self.kernel.db.writing("receive-drawing") as session:
            drawing = session.scalars(select(Drawing).where(Drawing.job_id == drawing_job_id)).one()
            held = session.get_one(Map, self.map_id, with_for_update=True)
            n, held.next_revision = held.next_revision, held.next_revision + 1
            enqueue(
                session,
                JobKind.BUILD_REVISION,
                job_id=job_id,
                map_id=self.map_id,
                subject_id=revision_id,
                key_id=self.key_id,
                now=now,
            )
            session.add(
                Revision(
                    id=revision_id,
                    map_id=self.map_id,
                    n=n,
                    status="building",
                    recipe=Recipe(**recipe).to_json(),
                    drawing_id=drawing.id,
                    walls_sha256=drawing.walls_sha256 or drawing.blob_sha256,
                    scale=(drawing.reading or {"scale": {"state": "given"}})["scale"],
                    job_id=job_id,
                    created_at=now,
                    created_by=self.key_id,
                )
            )
        return job_id

    def add_delta(self, *, old: bytes, new: bytes) -> str:
        """Return the job that makes the delta between two files, asked for as a robot does."""
        sha256s = []
        for content in (old, new):
            with self.kernel.blobs.stage(max_bytes=len(content)) as staged:
                staged.write(content)
                sha256s.append(staged.keep().sha256)
        asker = Actor(self.key_id, Role.ADMIN)
        return ask_for_delta(
            self.kernel, asker, map_id=self.map_id, from_sha256=sha256s[0], to_sha256=sha256s[1]
        )

    def add_comparison(self, with_n: int, n: int) -> str:
        """Return the job that compares two revisions, asked for as a person does."""
        actor = Actor(self.key_id, Role.ADMIN)
        return compare(self.kernel, actor, map_id=self.map_id, n=n, with_n=with_n).job.id

    def add_rebuild(self, n: int) -> str:
        """Return the job that builds a revision again."""
        actor = Actor(self.key_id, Role.ADMIN)
        with self.kernel.db.writing("rebuild-revision") as session:
            return rebuild(self.kernel, session, actor, map_id=self.map_id, n=n).id

    def job(self, job_id: str) -> Job:
        """Return the job as it stands."""
        with self.kernel.db.reading() as session:
            job = session.get_one(Job, job_id)
            session.expunge(job)
            return job

    def wait(self, job_id: str, until: Callable[[Job], bool], *, patience_s: float = PATIENCE_S) -> Job:
        """Return the job once `until` holds; fail when it never does."""

        def told() -> str:
            job = self.job(job_id)
            return f"{job.kind} {job.state} attempt {job.attempt} {job.stage} {job.problem}"

        def held() -> Job | None:
            job = self.job(job_id)
            return job if until(job) else None

        return soon(held, told, patience_s=patience_s)

    def wait_final(self, job_id: str, *, patience_s: float = PATIENCE_S) -> Job:
        """Return the job once it has ended."""
        return self.wait(job_id, lambda j: JobState(j.state).is_final, patience_s=patience_s)

    def start_worker(self, **settings: str) -> Forked:
        """Return a real worker process; `settings` are GROUNDPLAN_ variables in lower case."""
        given = {f"GROUNDPLAN_{name.upper()}": value for name, value in settings.items()}
        environment = {
            **os.environ,
            "GROUNDPLAN_DATA_DIR": str(self.data_dir),
            "GROUNDPLAN_DATABASE_URL": self.url,
            **self.environment,
            **given,
        }
        log = (self.data_dir / "worker.log").open("ab")
        with log:
            return forked("worker", env=environment, stderr=log, stdout=log)

    @contextmanager
    def worker(self, **settings: str) -> Iterator[Forked]:
        """Give a running worker that is killed at the end."""
        process = self.start_worker(**settings)
        try:
            yield process
        finally:
            kill(process)

    def log(self) -> str:
        """Return what the workers logged."""
        return (self.data_dir / "worker.log").read_text(encoding="utf-8")

    def close(self) -> None:
        """Close the database."""
        self.kernel.db.close()


def kill(process: Forked) -> None:
    """Kill -9, wherever the process stands."""
    if process.poll() is None:
        process.send_signal(signal.SIGKILL)
    process.wait()


def children_of(pid: int) -> list[int]:
    """Return the processes that `pid` has started and that live."""
    try:
        return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text("ascii").split()]
    except (FileNotFoundError, ProcessLookupError):  # it has ended, perhaps while it is read
        return []
