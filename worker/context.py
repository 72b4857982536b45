"""What a job's handler sees of the world, and what its process tells the parent."""

from __future__ import annotations

import json
import os
import resource
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from service import crash_points
from service.db.jobs import Attempt
from service.db.models import Layer, Placement, Revision, Scan
from service.db.revisions import visible_layers
from service.domain.acceptance_table import Verdict
from service.domain.bounds import Bounds
from service.domain.errors import DomainError
from service.domain.evidence import PlacementEvidence
from service.domain.job_limits import JobLimits
from service.domain.layer_part import OUTLIER, TARGET, WHOLE, LayerPart
from service.domain.map_state import ErasedRegion
from service.domain.media import HEAD_BYTES
from service.domain.outbound import Network
from service.domain.plain import plain_text
from service.domain.reading_cost import Promise, ReadingLimits
from service.domain.reasons import Reason, kept_reasons
from service.domain.report import BuiltLayer, LayerInput
from service.domain.scan_options import ScanOptions
from service.domain.transform import Transform
from service.usecases.kernel import Kernel
from service.usecases.map_states import erased_of
from worker.formats.scan import read_upright_scan
from worker.formats.upright import load_upright
from worker.geometry.cloud.merge import PlacedLayer
from worker.geometry.cloud.point_cloud import Label, PointCloud
from worker.geometry.cloud.within import taken, within
from worker.geometry.scan.upright import UprightScan

_BETWEEN_PROGRESS_S = 0.1
_MOST_NAME_BYTES = 255
_CPU_GRACE_S = 5
_SPARE_BYTES = 512 << 20


class Messages:
    """Send messages to the parent: one JSON object a line, whole or not at all.

    Parameters
    ----------
    fd : int
        Where they go: a pipe that the parent reads.
    """

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def send(self, kind: str, **members: Any) -> None:
        """Send one message; `kind` is one of `crash_points.MESSAGES`."""
        assert kind in crash_points.MESSAGES
        line = json.dumps({"message": kind, **members}).encode() + b"\n"
        crash_points.reach(f"message-{kind}.before-send")
        while line:
            line = line[os.write(self._fd, line) :]
        crash_points.reach(f"message-{kind}.after-send")


@dataclass(frozen=True)
class ScanSource:
    """Hold where a scan's points are: its uploaded bytes, and what its job read of them, if that was kept."""

    id: str
    sha256: str
    file_name: str
    options: ScanOptions
    upright_sha256: str | None

    @classmethod
    def of(cls, scan: Scan) -> ScanSource:
        """Return the source that a row tells."""
        return cls(
            scan.id,
            scan.blob_sha256,
            scan.file_name,
            ScanOptions.from_json(scan.options),
            scan.upright_sha256,
        )


@dataclass(frozen=True, eq=False)
class LayerSource:
    """Hold what a layer of a revision is made from: a scan, its poses, and what is erased from it.

    Parameters
    ----------
    placed : Transform
        `T_map_scan` as the placement found it: the layer's part is told in the map as it was seen then.
    T_map_scan : Transform
        Where the layer lies now.
    told : BuiltLayer
        How it was judged, and who took it in.
    erased : sequence of ErasedRegion
        Regions that take points off this layer.
    """

    layer_id: str
    name: str
    scan: ScanSource
    placed: Transform
    T_map_scan: Transform
    labels_sha256: str | None
    part: LayerPart
    told: BuiltLayer
    erased: Sequence[ErasedRegion] = ()

    def input(self) -> LayerInput:
        """Return the source as a report tells it."""
        return LayerInput(
            layer_id=self.layer_id,
            name=self.name,
            scan_id=self.scan.id,
            scan_sha256=self.scan.sha256,
            scan_options=self.scan.options,
            placed=self.placed,
            T_map_scan=self.T_map_scan,
            labels_sha256=self.labels_sha256,
            part=self.part,
        )


@dataclass
class JobContext:
    """Hold one attempt's job, the kernel it works with, and a private folder that vanishes with it.

    `networks` are those that webhooks may lie in although they are not public.
    """

    kernel: Kernel
    attempt: Attempt
    workdir: Path
    bounds: Bounds
    messages: Messages
    limits: JobLimits
    networks: tuple[Network, ...] = ()
    file_name: str | None = None
    _told_at: float = float("-inf")
    _told_stage: str = ""

    def progress(self, stage: str, fraction: float) -> None:
        """Tell the parent how far the work is: the stage, and the share of the whole job, 0 to 1.

        Messages of one stage closer than 0.1 s are left out.
        """
        now = time.monotonic()
        if stage == self._told_stage and now - self._told_at < _BETWEEN_PROGRESS_S:
            return
        self._told_at, self._told_stage = now, stage
        self.messages.send("progress", stage=stage, fraction=round(min(max(fraction, 0.0), 1.0), 4))

    def folder(self, name: str) -> Path:
        """Return a new empty folder within the private one."""
        path = self.workdir / name
        path.mkdir()
        return path

    def uploaded(self, sha256: str, file_name: str) -> Path:
        """Return an upload's path, which ends in the name that its sender gave it.

        Readers call a file by the last part of its path: so a person is told of it by the name that the
        person knows. Nothing else lies beside it.
        """
        path = self.workdir / f"upload-{sha256}" / _last_part(file_name)
        path.parent.mkdir(exist_ok=True)
        if not path.is_symlink():
            path.symlink_to(self.kernel.blobs.path(sha256).absolute())
        return path

    def begin_reading(self, path: Path) -> None:
        """Limit this process, and what it starts, to what reading an upload may cost; tell the parent.

        Raises
        ------
        Rejected
            If the file's header alone shows that it is cut short or too large.
        """
        self.file_name = path.name
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        promise = Promise()
        if head:
            promise = Promise.of(head, size_bytes=path.stat().st_size, bounds=self.bounds)
        reading = ReadingLimits.of(promise, self.limits, file_name=path.name)
        self.bounds = replace(
            self.bounds,
            max_scan_memory_bytes=reading.memory_bytes,
            max_scan_seconds=reading.wall_s,
            max_model_seconds=reading.wall_s,
        )
        limit_process(memory_bytes=reading.memory_bytes, cpu_s=reading.cpu_s)
        self.messages.send("progress", stage="load", fraction=0.0, reading=reading.to_json())

    def problem(self, refusal: DomainError) -> dict[str, Any]:
        """Return a refusal as the job's problem; where a file is read, it calls the file by its name."""
        problem = refusal.problem()
        if self.file_name is not None:
            if self.file_name not in refusal.detail:
                problem["detail"] = f"{self.file_name}: {refusal.detail}"
            problem["file_name"] = self.file_name
        return problem

    def layer_sources(self, revision_id: str) -> list[LayerSource]:
        """Return what a revision's visible layers are made from, in their order."""
        with self.kernel.db.reading() as session:
            erased = erased_of(session.get_one(Revision, revision_id))
            rows = visible_layers(session, revision_id)
        return [
            LayerSource(
                layer_id=layer.layer_id,
                name=layer.name,
                scan=ScanSource.of(scan),
                placed=Transform(np.array(placement.T_map_scan)),
                T_map_scan=Transform(np.array(layer.T_map_scan or placement.T_map_scan)),
                labels_sha256=placement.labels_sha256,
                part=WHOLE if layer.part is None else LayerPart.from_json(layer.part),
                told=_told(layer, placement),
                erased=[one for one in erased if layer.layer_id in one.layers],
            )
            for layer, scan, placement in rows
        ]

    def load_scan(self, source: ScanSource) -> UprightScan:
        """Return a scan as its job has read it, in frame `scan` and with the turn that makes it upright.

        Raises
        ------
        Rejected
            If the scan cannot be read; the leaf tells why. Only one read before this was kept can be refused.
        """
        if source.upright_sha256 is not None:
            return load_upright(self.kernel.blobs.path(source.upright_sha256))
        path = self.uploaded(source.sha256, source.file_name)
        return read_upright_scan(path, self.bounds, options=source.options)

    def load_layer(self, source: LayerSource) -> PlacedLayer:
        """Return the part of a scan that a layer holds, in frame `map`, without the points that stand alone.

        Regions are erased where the layer lay when they were: a layer moved later takes its holes along.

        Raises
        ------
        Rejected
            If the scan cannot be read; the leaf tells why.
        """
        upright = self.load_scan(source.scan)
        scan = upright.scan.points
        labels = np.where(upright.outliers, OUTLIER, TARGET).astype(np.uint8)
        if source.labels_sha256 is not None:
            labels = np.load(self.kernel.blobs.path(source.labels_sha256), allow_pickle=False)
        held = taken(source.part, source.placed.apply(scan), labels)
        for one in source.erased:
            then = Transform.of(one.layers[source.layer_id])
            held &= ~within(one.region, then.apply(scan))
        points = source.T_map_scan.apply(scan[held])
        return PlacedLayer(source.name, PointCloud.of(points, Label.LAYER), source.told)


def _told(layer: Layer, placement: Placement) -> BuiltLayer:
    evidence = None if placement.evidence is None else PlacementEvidence.of_row(placement.evidence)
    return replace(
        BuiltLayer.unjudged(layer.name),
        layer_id=layer.layer_id,
        placement_id=placement.id,
        verdict=cast("Verdict | None", placement.verdict),
        reasons=[Reason.of_row(one) for one in kept_reasons(placement.reasons)],
        evidence=evidence,
        covariance=None if evidence is None else evidence.covariance,
        accepted_by=layer.accepted_by,
        accepted_at=None if layer.accepted_at is None else layer.accepted_at.isoformat(),
    )


def _last_part(file_name: str) -> str:
    """Return a name as a file system takes it (255 bytes, no separator), its end kept."""
    name = plain_text(file_name).replace("/", "_").encode()[-_MOST_NAME_BYTES:].decode(errors="ignore")
    return "unnamed" if name in {"", ".", ".."} else name


def limit_process(*, memory_bytes: int, cpu_s: float) -> None:
    """Limit what this process takes from here on; never above a limit that it has.

    RLIMIT_DATA counts private writable memory, so an allocation past it fails as MemoryError; address
    space that is only reserved (numba, threads' arenas) or mapped from files does not count, as it
    would under RLIMIT_AS. It has some to spare: the parent counts what all processes of a job really hold,
    and is the quicker one where memory is taken bit by bit.
    """
    most = _data_bytes() + memory_bytes + _SPARE_BYTES
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = most if hard == resource.RLIM_INFINITY else min(most, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    used = resource.getrusage(resource.RUSAGE_SELF)
    until = int(used.ru_utime + used.ru_stime + cpu_s) + 1
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    last = until + _CPU_GRACE_S if hard == resource.RLIM_INFINITY else min(until + _CPU_GRACE_S, hard)
    resource.setrlimit(resource.RLIMIT_CPU, (min(until, last), last))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _data_bytes() -> int:
    """Return what this process has of what RLIMIT_DATA counts."""
    statm = Path("/proc/self/status").read_text(encoding="ascii")
    return int(statm.partition("VmData:")[2].split()[0]) * 1024
