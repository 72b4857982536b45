"""The worker's part played by hand: jobs are claimed and their results recorded as a worker would."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select

from service.db.jobs import Attempt, claim, finish_failed
from service.db.models import Job, Key
from service.domain.acceptance import Judgement
from service.domain.acceptance_table import Verdict
from service.domain.access import Actor
from service.domain.drawing_options import DrawingOptions
from service.domain.lifecycle import Role
from service.domain.reasons import Reason
from service.domain.rough_pose import RoughPose
from service.domain.scan_options import SaidOfScan
from service.domain.transform import Transform
from service.storage.blobs import Stored
from service.usecases.drawings import reread_drawing
from service.usecases.kernel import Kernel
from service.usecases.receive_drawing import receive_drawing
from service.usecases.receive_file import ReceivedFile
from service.usecases.receive_scan import receive_scan
from service.usecases.record_drawing_reading import record_drawing_reading
from service.usecases.record_placement import PlacementResult, record_placement
from service.usecases.record_revision import record_revision
from service.usecases.record_scan_reading import record_scan_reading
from tests.unit.placement_evidence import GOOD

IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
CLOUD = bytes(range(256)) * 400
PICTURE = base64.b64decode(
    b"iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mP8z8BQDwAEhQGAhKmMIQAAAABJRU5ErkJggg=="
)
NO_TILES = b'{"tile_size_m": 20, "tiles": []}'
LEASE_S = 600.0
SEEN_BY_HAND = Reason("seen", {"people": 1}, detail="seen by hand")


@dataclass(frozen=True)
class ByHand:
    """Act as the worker on a service's data."""

    kernel: Kernel

    def actor(self) -> Actor:
        """Return some admin."""
        with self.kernel.db.reading() as session:
            key = session.scalars(select(Key).where(Key.role == "admin").order_by(Key.id).limit(1)).one()
            return Actor(key.id, Role.ADMIN)

    def keep(self, content: bytes) -> Stored:
        """Return bytes as a blob."""
        with self.kernel.blobs.stage(max_bytes=1 << 30) as staged:
            staged.write(content)
            return staged.keep()

    def claim(self, job_id: str) -> Attempt:
        """Return an attempt at the job."""
        token = self.kernel.new_id("att")
        with self.kernel.db.writing("claim-job") as session:
            attempt = claim(
                session,
                worker="by hand",
                token=token,
                lease_s=LEASE_S,
                now=self.kernel.now(),
                job_id=job_id,
            )
        assert attempt is not None
        return attempt

    def fail(self, job_id: str, *, problem: dict[str, Any]) -> None:
        """End a job with a problem."""
        attempt = self.claim(job_id)
        with self.kernel.db.writing("end-job") as session:
            finish_failed(session, attempt, problem=problem, now=self.kernel.now())

    def drawing(self, map_id: str, *, read: bool = True, scaled: bool = True) -> str:
        """Return the id of a drawing, read or not."""
        stored = self.keep(b"a drawing of " + map_id.encode())
        file = ReceivedFile(stored.sha256, stored.size_bytes, "hall.png", "image/png")
        with self.kernel.db.writing("receive-drawing") as session:
            received = receive_drawing(
                self.kernel, session, self.actor(), map_id=map_id, file=file, options=DrawingOptions()
            )
            drawing_id, job_id = received.drawing.id, received.job.id
        if read:
            scale = {"state": "given", "metres_per_unit": 0.05} if scaled else {"state": "unknown"}
            files = {n: self.keep(n.encode()) for n in ("walls.geojson", "removed.geojson", "preview.png")}
            attempt = self.claim(job_id)
            with self.kernel.db.writing("record-drawing-reading") as session:
                record_drawing_reading(self.kernel, session, attempt, reading={"scale": scale}, files=files)
        return drawing_id

    def reread(self, drawing_id: str, *, walls: bytes) -> None:
        """Read the drawing again, as a corrected scale asks for, and find these walls."""
        with self.kernel.db.writing("reread-drawing") as session:
            actor = self.actor()
            _, _, job = reread_drawing(
                self.kernel, session, actor, drawing_id=drawing_id, change=lambda now: now
            )
            job_id = job.id
        files = {"walls.geojson": walls, "removed.geojson": b"removed", "preview.png": b"preview"}
        attempt = self.claim(job_id)
        reading = {"scale": {"state": "given", "metres_per_unit": 0.07}}
        kept = {name: self.keep(content) for name, content in files.items()}
        with self.kernel.db.writing("record-drawing-reading") as session:
            record_drawing_reading(self.kernel, session, attempt, reading=reading, files=kept)

    def scan(self, map_id: str, *, read: bool = True, rough_pose: RoughPose | None = None) -> str:
        """Return the id of a scan, read or not."""
        stored = self.keep(b"a scan of " + map_id.encode())
        file = ReceivedFile(stored.sha256, stored.size_bytes, "scan.ply", "application/octet-stream")
        with self.kernel.db.writing("receive-scan") as session:
            received = receive_scan(
                self.kernel, session, self.actor(), map_id=map_id, file=file, said=SaidOfScan(rough_pose)
            )
            scan_id, job_id = received.scan.id, received.job.id
        if read:
            files = {name: self.keep(name.encode()) for name in ("points.pcd", "preview.png", "upright.npz")}
            attempt = self.claim(job_id)
            with self.kernel.db.writing("record-scan-reading") as session:
                record_scan_reading(self.kernel, session, attempt, reading={"points": 3}, files=files)
        return scan_id

    def build(
        self,
        job_id: str,
        *,
        cloud: bytes = CLOUD,
        more: Mapping[str, bytes] | None = None,
        without: Mapping[str, dict[str, Any]] | None = None,
    ) -> None:
        """End the build of a revision well, with `more` files; `without` some, with the finding of each."""
        attempt, gone = self.claim(job_id), without or {}
        contents = {"point-cloud.pcd": cloud, "preview.png": PICTURE, "report.json": b"{}", **(more or {})}
        files = {path: self.keep(content) for path, content in contents.items() if path not in gone}
        report = {"frame": "map", **({"findings": [*gone.values()]} if gone else {})}
        with self.kernel.db.writing("record-revision") as session:
            record_revision(self.kernel, session, attempt, report=report, version="by hand", files=files)

    def place(self, job_id: str, *, verdict: Verdict = "accepted") -> None:
        """End a placement with a verdict."""
        attempt = self.claim(job_id)
        result = PlacementResult(Transform.identity(), Judgement(verdict, (SEEN_BY_HAND,)), GOOD)
        with self.kernel.db.writing("record-placement") as session:
            record_placement(
                self.kernel, session, attempt, result=result, files={"labels.npy": self.keep(b"labels")}
            )

    def beat(self, job_id: str, *, stage: str, fraction: float) -> None:
        """Show progress of a running job."""
        with self.kernel.db.writing("beat-job") as session:
            job = session.get_one(Job, job_id)
            job.stage, job.fraction, job.changed = stage, fraction, job.changed + 1
