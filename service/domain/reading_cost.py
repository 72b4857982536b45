"""What reading an upload may cost: it grows with what the file's checked header and its size promise."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Self

from service.domain.bounds import Bounds
from service.domain.errors import DomainError, ReaderCrashed, ReadingTooCostly
from service.domain.formats import Media
from service.domain.headers import Told, check_header
from service.domain.job_limits import JobLimits, Limit, Limits, Usage
from service.domain.media import recognise

STEP_CPU_S = 10.0
"""CPU for each further step of what is promised: a scan of a hall takes 9 s a million points."""

STEP_POINTS, STEP_PIXELS, STEP_CAD_BYTES = 1_000_000, 10_000_000, 10_000_000
"""One step each; the first is part of what every file may take."""

_GIB = 1 << 30
_BYTES_PER_POINT = 180
_BYTES_PER_PIXEL = 12


@dataclass(frozen=True)
class Promise:
    """Hold the most that a file can hold by its header, or else by its size."""

    points: int = 0
    pixels: int = 0
    cad_bytes: int = 0
    apart_bytes: int = 0
    """Memory that `Bounds` gives a library which works in a process of its own."""

    @classmethod
    def of(cls, head: bytes, *, size_bytes: int, bounds: Bounds) -> Self:
        """Return the promise of a file.

        Parameters
        ----------
        head : bytes
            The first `media.HEAD_BYTES` of the file.
        size_bytes : int
            Size of the whole file.
        bounds : Bounds
            The most that is read: no promise is larger.

        Raises
        ------
        Rejected
            As `check_header` does.

        Notes
        -----
        Where a header does not tell, a point takes the fewest bytes that its format writes one in, and a
        packed sheet a byte for 256 pixels: drawn sheets pack (CCITT G4, PNG) to one for 20 to 150.
        """
        media = recognise(head)
        told = check_header(head, media, size_bytes=size_bytes, bounds=bounds)
        return cls(
            points=_points(media, told, size_bytes, bounds),
            pixels=_pixels(media, told, size_bytes, bounds),
            cad_bytes=size_bytes if media.is_cad else 0,
            apart_bytes=getattr(bounds, media.memory_bound) if media.memory_bound else 0,
        )

    def cpu_s(self, base_s: float) -> float:
        """Return the CPU seconds that reading the file may take: `base_s`, and more for each further step."""
        steps = (
            max(0.0, self.points / STEP_POINTS - 1.0)
            + max(0.0, self.pixels / STEP_PIXELS - 1.0)
            + max(0.0, self.cad_bytes / STEP_CAD_BYTES - 1.0)
        )
        return base_s + STEP_CPU_S * steps

    def memory_bytes(self, base_bytes: int) -> int:
        """Return the memory that reading the file may take: `base_bytes`, or what its content needs.

        Notes
        -----
        Measured: 136 bytes a point (PCD and LAZ halls of 1.6 to 10 million), 8 a pixel (sheets of 20 to
        100 Mpx); a quarter or more is added.
        """
        content = _BYTES_PER_POINT * self.points + _BYTES_PER_PIXEL * self.pixels
        return max(base_bytes, _GIB + content + self.apart_bytes)

    def words(self) -> str:
        """Return the promise for people."""
        said = [
            f"{self.points / 1e6:.3g} million points" if self.points else "",
            f"{self.pixels / 1e6:.3g} Mpx" if self.pixels else "",
            f"{self.cad_bytes / 1e6:.3g} MB of drawing" if self.cad_bytes else "",
        ]
        return " and ".join(part for part in said if part) or "this kind"


@dataclass(frozen=True)
class ReadingLimits(Limits):
    """Hold what reading one file may take, and why.

    Parameters
    ----------
    memory_bytes : int
        Memory that the processes which read it take beyond what a worker stands ready with.
    cpu_s : float
        Their CPU seconds, together.
    wall_s : float
        Seconds of the clock.
    file_name : str
        As its sender called it.
    promise : Promise
        What the limits follow from.
    """

    file_name: str
    promise: Promise

    @classmethod
    def of(cls, promise: Promise, may: JobLimits, *, file_name: str) -> Self:
        """Return the limits that follow from a promise: no job may take more than any job may."""
        return cls(
            memory_bytes=min(promise.memory_bytes(may.reading_memory_bytes), may.memory_bytes),
            cpu_s=min(promise.cpu_s(may.reading_cpu_s), may.cpu_s),
            wall_s=may.wall_s,
            file_name=file_name,
            promise=promise,
        )

    def to_json(self) -> dict[str, Any]:
        """Return the limits as a JSON object."""
        return asdict(self)

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Self:
        """Return the limits that a JSON object tells."""
        return cls(**{**value, "promise": Promise(**value["promise"])})

    def refusal(self, limit: Limit, used: Usage) -> DomainError:
        """Return the refusal of a file whose reading was stopped at a limit."""
        return ReadingTooCostly(
            f"Reading {self.file_name} {self.took(limit, used)}; a file of {self.promise.words()} may take "
            f"{self.most(limit)}. {self._advice()}",
            **self.members(limit, used),
            points=self.promise.points,
            pixels=self.promise.pixels,
            cad_bytes=self.promise.cad_bytes,
        )

    def _advice(self) -> str:
        if self.promise.points:
            return "Thin the scan, or export it in parts; one that is small already is damaged."
        if self.promise.cad_bytes:
            return "Save the one floor that is needed, without hatches, furniture and unused blocks."
        return "Export the sheet at a lower resolution, or cut it to the plan."


def reader_crashed(file_name: str, *, how: str) -> ReaderCrashed:
    """Return the refusal of a file on which the process that read it ended by a fault of its own."""
    return ReaderCrashed(
        f"The reader crashed on {file_name} ({how}): it is damaged. Open it in the program that made it, "
        "repair it, and export it again.",
        file_name=file_name,
        signal=how,
    )


def _points(media: Media, told: Told, size_bytes: int, bounds: Bounds) -> int:
    if media.least_point_bytes is None:
        return 0
    points = told.points if told.points is not None else size_bytes // media.least_point_bytes
    return min(points, bounds.max_points)


def _pixels(media: Media, told: Told, size_bytes: int, bounds: Bounds) -> int:
    if media.most_pixels_per_byte is None:
        return 0
    pixels = told.pixels if told.pixels is not None else size_bytes * media.most_pixels_per_byte
    return min(pixels, bounds.max_pixels)
