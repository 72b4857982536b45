"""What is for people alone and cannot be made fails no revision; what the machine lacks does."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from service.domain.errors import NoWallsFound
from service.domain.recipe import Recipe
from worker.formats import artifacts
from worker.formats.artifacts import write_artifacts
from worker.formats.for_people import write_picture, write_what_can_be
from worker.formats.octree import write_octree
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.drawing.reading.reading import Wall

OCTREE, PREVIEW = {"octree.bin", "octree.json"}, {"preview.png"}
NOTHING = PointCloud.of(np.zeros((0, 3)))


def built(folder: Path) -> tuple[dict[str, bytes], list[dict[str, object]]]:
    """Return the files of a room by their paths, and the findings of its report."""
    folder.mkdir()
    corners = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 5.0], [0.0, 5.0], [0.0, 0.0]])
    walls = [Wall.of(corners[i : i + 2], thickness=0.2) for i in range(4)]
    paths = write_artifacts(folder, walls=walls, recipe=Recipe(voxel_size_m=0.2), inputs={})
    files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert there == set(files), "what is not told of is not there"
    return files, json.loads(files.pop("report.json"))["findings"]


def _octree_of_nothing(folder: Path, _cloud: PointCloud) -> list[Path]:
    (folder / "octree.bin").write_bytes(b"half of it")
    return write_octree(folder, NOTHING)


def _picture_of_nothing(path: Path, *_map: object) -> None:
    path.write_bytes(b"half of it")
    write_picture(path, [], [], NOTHING)


@pytest.mark.parametrize(
    ("missing", "faults"),
    [
        (OCTREE, {"write_octree": _octree_of_nothing}),
        (PREVIEW, {"write_picture": _picture_of_nothing}),
        (OCTREE | PREVIEW, {"write_octree": _octree_of_nothing, "write_picture": _picture_of_nothing}),
    ],
)
def test_the_map_is_whole_without_what_is_for_people(
    tmp_path: Path,
    missing: set[str],
    faults: dict[str, Callable[..., object]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, nothing = built(tmp_path / "whole")
    assert nothing == []
    for name, fault in faults.items():
        monkeypatch.setattr(artifacts, name, fault)
    files, findings = built(tmp_path / "without")
    assert files == {path: content for path, content in whole.items() if path not in missing}
    told = [name for one in findings for name in one["values"]["files"]]  # type: ignore[attr-defined]
    assert (sorted(told), {one["code"] for one in findings}) == (sorted(missing), {"file-not-made"})
    assert all("ValueError" in str(one["message"]) for one in findings)


class _Machine:
    """Fail as the machine does, and not one file."""

    @staticmethod
    def full() -> None:
        Path("/dev/full").write_bytes(b"x")

    @staticmethod
    def in_the_way() -> None:
        Path("/dev").write_bytes(b"x")

    @staticmethod
    def no_memory() -> None:
        raise MemoryError

    @staticmethod
    def refusal() -> None:
        raise NoWallsFound("none")


@pytest.mark.parametrize(
    ("fault", "raised"),
    [
        (_Machine.full, OSError),
        (_Machine.in_the_way, IsADirectoryError),
        (_Machine.no_memory, MemoryError),
        (_Machine.refusal, NoWallsFound),
    ],
)
def test_what_is_no_fault_of_one_file_is_raised(
    tmp_path: Path, fault: Callable[[], None], raised: type[BaseException]
) -> None:
    with pytest.raises(raised):
        write_what_can_be(tmp_path, {("preview.png",): fault})
