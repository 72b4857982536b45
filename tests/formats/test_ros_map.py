"""Robots' maps: what is occupied is wall, beside the YAML or in a ZIP, and maps that are refused."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from service.domain.bounds import Bounds
from service.domain.drawing_options import DrawingOptions
from service.domain.errors import (
    DomainError,
    DrawingTooComplex,
    FileEmpty,
    FileMalformed,
    FileTruncated,
    HeaderMismatch,
    ImageTooLarge,
    NotFinite,
    NoWallsFound,
    UnsupportedMedia,
)
from service.domain.scale_hint import ScaleHint
from worker.formats.drawing import read_drawing_file
from worker.formats.grey_map import load_pgm
from worker.formats.occupancy import write_occupancy
from worker.formats.ros_map import load_ros_map
from worker.geometry.cloud.occupancy_grid import occupancy_grid
from worker.geometry.drawing.reading.reading import Wall

HEADER = "image: map.pgm\nresolution: 0.05\norigin: [-1.0, -2.0, 0.0]\nnegate: 0\n"
THRESHOLDS = "occupied_thresh: 0.65\nfree_thresh: 0.196\n"


def _room() -> NDArray[np.uint8]:
    """Return a map of 200 x 120 cells: a room of 8 x 4 m with walls of two cells, unknown around."""
    grey = np.full((120, 200), 205, dtype=np.uint8)
    grey[18:102, 18:182] = 0
    grey[20:100, 20:180] = 254
    return grey


def _pgm(grey: NDArray[np.uint8]) -> bytes:
    return b"P5\n# a comment\n%d %d\n255\n" % (grey.shape[1], grey.shape[0]) + grey.tobytes()


def _write(folder: Path, header: str = HEADER + THRESHOLDS, image: bytes | None = None) -> Path:
    (folder / "map.pgm").write_bytes(_pgm(_room()) if image is None else image)
    path = folder / "map.yaml"
    path.write_text(header)
    return path


def _zip(path: Path, *members: tuple[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members:
            archive.writestr(name, content)
    return path


def test_a_room_is_read_at_the_resolution_that_the_map_states(tmp_path: Path) -> None:
    reading = load_ros_map(_write(tmp_path))
    assert reading.scale.state == "found"
    assert reading.scale.metres_per_unit == 0.05
    assert reading.sheet == pytest.approx((10.0, 6.0))
    points = np.vstack([f for w in reading.walls for f in w.faces])
    assert points.min(axis=0) == pytest.approx([0.9, 0.9], abs=0.026)
    assert points.max(axis=0) == pytest.approx([9.1, 5.1], abs=0.026)
    assert [w.thickness for w in reading.walls] == pytest.approx([0.1] * 4, abs=0.02)
    robot = next(f for f in reading.findings if f.code == "robot-map")
    assert robot.values == {"x_m": -1.0, "y_m": -2.0, "yaw_rad": 0.0, "resolution_m": 0.05}


def test_a_zip_of_both_reads_as_the_two_files(tmp_path: Path) -> None:
    beside = load_ros_map(_write(tmp_path))
    path = _zip(tmp_path / "upload", ("map.yaml", (HEADER + THRESHOLDS).encode()), ("map.pgm", _pgm(_room())))
    zipped = read_drawing_file(path, options=DrawingOptions())
    assert [w.centre.tolist() for w in zipped.walls] == [w.centre.tolist() for w in beside.walls]


@pytest.mark.parametrize("kind", ["png", "bmp", "p2", "rgba"])
def test_every_kind_of_image_reads_the_same(kind: str, tmp_path: Path) -> None:
    grey = _room()
    image = Image.fromarray(grey)
    buffer = io.BytesIO()
    if kind == "p2":
        rows = "\n".join(" ".join(map(str, row)) for row in grey.tolist())
        buffer.write(f"P2\n200 120\n255\n{rows}\n".encode())
    elif kind == "rgba":
        alpha = np.where(grey == 205, 0, 255).astype(np.uint8)
        Image.merge("RGBA", [image, image, image, Image.fromarray(alpha)]).save(buffer, format="PNG")
    else:
        image.save(buffer, format=kind.upper())
    reading = load_ros_map(_write(tmp_path, image=buffer.getvalue()))
    assert len(reading.walls) == 4
    assert reading.counts["occupied_cells"] == 84 * 164 - 80 * 160


def test_negate_and_raw_are_understood(tmp_path: Path) -> None:
    negated = _write(tmp_path, HEADER.replace("negate: 0", "negate: 1") + THRESHOLDS, _pgm(255 - _room()))
    assert len(load_ros_map(negated).walls) == 4
    raw = np.select([_room() == 0, _room() == 205], [100, 255], 0).astype(np.uint8)
    reading = load_ros_map(_write(tmp_path, HEADER + THRESHOLDS + "mode: raw\n", _pgm(raw)))
    assert len(reading.walls) == 4
    assert reading.counts["unknown_cells"] == 120 * 200 - 84 * 164


def test_a_slanted_noisy_wall_stays_where_it_is(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    grey = np.full((240, 240), 254, dtype=np.uint8)
    along = np.linspace(0.0, 1.0, 4000)
    x, y = 20 + 180 * along + rng.normal(0, 0.4, 4000), 30 + 75 * along + rng.normal(0, 0.4, 4000)
    grey[np.rint(239 - y).astype(int), np.rint(x).astype(int)] = 0
    grey[rng.integers(0, 240, 40), rng.integers(0, 240, 40)] = 0
    reading = load_ros_map(_write(tmp_path, image=_pgm(grey)))
    points = np.vstack([w.centre for w in reading.walls]) / 0.05 - 0.5
    normal = np.array([-75.0, 180.0]) / np.hypot(75.0, 180.0)
    assert np.abs((points - (20, 30)) @ normal).max() < 3.0
    assert sum(w.length for w in reading.walls) >= 0.95 * 0.05 * np.hypot(180, 75)
    assert reading.counts["specks"] > 20


def test_the_grid_of_a_map_reads_back_as_its_walls(tmp_path: Path) -> None:
    corners = np.array([(1.0, 1.0), (9.0, 1.0), (9.0, 5.0), (1.0, 5.0), (1.0, 2.0)])
    walls = [Wall.of(corners[[i, i + 1]], thickness=0.2) for i in range(4)]
    image, header = write_occupancy(tmp_path, occupancy_grid(walls, resolution=0.05))
    assert image.is_file()
    reading = load_ros_map(header)
    told = next(f for f in reading.findings if f.code == "robot-map").to_json()["values"]
    faces = np.vstack([f for w in reading.walls for f in w.faces]) + np.array([told["x_m"], told["y_m"]])
    assert faces.min(axis=0) == pytest.approx([0.9, 0.9], abs=0.06)
    assert faces.max(axis=0) == pytest.approx([9.1, 5.1], abs=0.06)
    assert sum(w.length for w in reading.walls) == pytest.approx(23.0, abs=0.6)
    assert all(w.thickness == pytest.approx(0.2, abs=0.06) for w in reading.walls)


def test_a_word_on_the_scale_wins(tmp_path: Path) -> None:
    reading = load_ros_map(_write(tmp_path), hint=ScaleHint(metres_per_unit=0.1))
    assert reading.scale.state == "given"
    assert reading.sheet == pytest.approx((20.0, 12.0))
    assert "scale-contradicted" in {f.code for f in reading.findings}


@pytest.mark.parametrize(
    ("header", "leaf"),
    [
        ("", FileEmpty),
        (HEADER.replace("0.05", ".nan"), NotFinite),
        (HEADER.replace("-1.0", ".inf"), NotFinite),
        (HEADER.replace("0.05", "-0.05"), FileMalformed),
        (HEADER.replace("0.05", "0"), FileMalformed),
        (HEADER.replace("0.05", "five"), FileMalformed),
        (HEADER.replace("resolution: 0.05\n", ""), FileMalformed),
        (HEADER.replace("[-1.0, -2.0, 0.0]", "[1]"), FileMalformed),
        (HEADER + "occupied_thresh: 0.1\nfree_thresh: 0.9\n", FileMalformed),
        (HEADER + "mode: thermal\n", FileMalformed),
        (HEADER.replace("map.pgm", "other.pgm"), HeaderMismatch),
        (HEADER.replace("map.pgm", "../map.pgm"), FileMalformed),
        (HEADER.replace("map.pgm", "../map/map.pgm"), FileMalformed),
        (HEADER.replace("map.pgm", "a/../map.pgm"), FileMalformed),
        (HEADER.replace("map.pgm", "'..\\map.pgm'"), FileMalformed),
        (HEADER.replace("map.pgm", "/opt/robot/../map.pgm"), FileMalformed),
        (HEADER.replace("map.pgm", "/etc/passwd"), HeaderMismatch),
        (HEADER.replace("map.pgm", "'..'"), FileMalformed),
        (HEADER.replace("map.pgm", "'.'"), FileMalformed),
        (HEADER.replace("map.pgm", "'/'"), FileMalformed),
        (HEADER.replace("map.pgm", "'C:'"), FileMalformed),
        (HEADER.replace("map.pgm", "./map.pgm/"), FileMalformed),
        (HEADER.replace("map.pgm", '"map\\0.pgm"'), FileMalformed),
        (HEADER.replace("map.pgm", "[map.pgm]"), FileMalformed),
        (HEADER.replace("map.pgm", "'a\\b'"), HeaderMismatch),
        (HEADER.replace("map.pgm", "map.pgm.old"), HeaderMismatch),
        (HEADER.replace("map.pgm", "&a map.pgm"), FileMalformed),
    ],
)
def test_each_bad_header_has_its_own_problem(header: str, leaf: type[DomainError], tmp_path: Path) -> None:
    with pytest.raises(leaf):
        load_ros_map(_write(tmp_path, header))


@pytest.mark.parametrize(
    "said",
    [
        "./map.pgm",
        "././/map.pgm",
        "/opt/robot/maps/map.pgm",
        "~/maps/map.pgm",
        "'C:\\Users\\robot\\maps\\map.pgm'",
        "C:/maps/map.pgm",
        "'.\\map.pgm'",
        "file:///opt/robot/map.pgm",
        "package://plant_maps/maps/map.pgm",
        "'\\\\server\\maps\\map.pgm'",
        "maps/map.pgm",
        "Map.PGM",
        "'map.pgm'",
        '"./map.pgm"  # saved by robot',
    ],
)
def test_the_image_is_found_by_its_name(said: str, tmp_path: Path) -> None:
    header = (HEADER + THRESHOLDS).replace("map.pgm", said)
    path = _write(tmp_path, header)
    beside = read_drawing_file(path, options=DrawingOptions())
    assert beside.sheet == pytest.approx((10.0, 6.0))
    assert len(beside.walls) == 4
    for names in (("map.yaml", "map.pgm"), ("plant/map.yaml", "plant/map.pgm"), ("m/map.yml", "img/map.pgm")):
        packed = _zip(tmp_path / "upload", (names[0], header.encode()), (names[1], _pgm(_room())))
        assert len(read_drawing_file(packed, options=DrawingOptions()).walls) == 4


@pytest.mark.parametrize(
    "said", ["images/map.pgm", "./images/map.pgm", "Images/MAP.pgm", "'images\\map.pgm'"]
)
def test_an_image_in_a_folder_below_is_taken_before_one_beside(said: str, tmp_path: Path) -> None:
    path = _write(tmp_path, (HEADER + THRESHOLDS).replace("map.pgm", said), image=b"another")
    (tmp_path / "images").mkdir()
    (tmp_path / "images" / "map.pgm").write_bytes(_pgm(_room()))
    assert len(load_ros_map(path).walls) == 4


def test_of_two_names_in_other_letters_none_is_guessed(tmp_path: Path) -> None:
    path = _write(tmp_path, (HEADER + THRESHOLDS).replace("map.pgm", "Map.PGM"))
    (tmp_path / "MAP.pgm").write_bytes(_pgm(_room()))
    with pytest.raises(HeaderMismatch, match=r"Map\.PGM"):
        load_ros_map(path)
    (tmp_path / "Map.PGM").write_bytes(_pgm(_room()))
    assert len(load_ros_map(path).walls) == 4


@pytest.mark.parametrize("prefix", ["", "\ufeff"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("number", ["0.05", "5e-2", "5.0E-02", ".05", "0.050000000000", "+5.e-2"])
def test_headers_of_other_programs_are_read(prefix: str, ending: str, number: str, tmp_path: Path) -> None:
    header = "# saved by robot\n" + (HEADER + THRESHOLDS).replace("0.05", number)
    path = _write(tmp_path)
    path.write_bytes((prefix + header.replace("\n", ending)).encode())
    reading = read_drawing_file(path, options=DrawingOptions())
    assert reading.scale.metres_per_unit == pytest.approx(0.05)
    assert len(reading.walls) == 4


def test_a_folder_packed_by_a_desktop_is_read(tmp_path: Path) -> None:
    header = (HEADER + THRESHOLDS).replace("map.pgm", "地図.pgm").encode()
    path = tmp_path / "upload"
    with zipfile.ZipFile(path, "w") as archive:
        archive.mkdir("plant")
        archive.writestr("plant/map.yaml", header)
        archive.writestr("plant/地図.pgm", _pgm(_room()))
        archive.writestr("plant/.DS_Store", b"x")
        archive.writestr("__MACOSX/plant/._map.yaml", b"x")
    assert len(read_drawing_file(path, options=DrawingOptions()).walls) == 4
    japanese = zipfile.ZipInfo("地図.pgm".encode("cp932").decode("cp437"))  # as Windows in Japan packs it
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("maps\\map.yaml", header)
        archive.writestr(japanese, _pgm(_room()))
    packed = path.read_bytes()
    wanted, flagged = "地図.pgm".encode("cp932"), japanese.filename.encode()
    path.write_bytes(_renamed(packed, flagged, wanted))
    assert len(read_drawing_file(path, options=DrawingOptions()).walls) == 4


def _renamed(packed: bytes, name: bytes, by: bytes) -> bytes:
    """Return a ZIP whose second entry is called otherwise, in bytes that are not said to be UTF-8."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(packed)) as source, zipfile.ZipFile(buffer, "w") as archive:
        for entry in source.infolist():
            content = source.read(entry)
            plain = entry.filename if entry.filename.encode() != name else "x" * len(by)
            archive.writestr(plain, content)
    return buffer.getvalue().replace(b"x" * len(by), by)


@pytest.mark.parametrize("folder", ["comment-crlf", "abs-path"])
def test_the_collected_maps_are_read(folder: str, shared_cases: Path) -> None:
    path = shared_cases / "44-ros-map-image-path" / folder / "map.yaml"
    reading = read_drawing_file(path, options=DrawingOptions())
    corners = np.vstack([face for wall in reading.walls for face in wall.faces])
    assert corners.min(axis=0) == pytest.approx([2.0, 2.0], abs=0.03)
    assert corners.max(axis=0) == pytest.approx([22.0, 14.0], abs=0.03)


def test_a_yaml_that_was_uploaded_alone_looks_at_no_neighbour(tmp_path: Path) -> None:
    path = _write(tmp_path)
    alone = path.rename(tmp_path / "5f2c")
    with pytest.raises(HeaderMismatch, match="ZIP"):
        read_drawing_file(alone, options=DrawingOptions())


def test_a_link_out_of_the_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(_pgm(_room()))
    folder = tmp_path / "map"
    folder.mkdir()
    (folder / "map.yaml").write_text(HEADER + THRESHOLDS)
    (folder / "map.pgm").symlink_to(tmp_path / "secret")
    with pytest.raises(HeaderMismatch):
        load_ros_map(folder / "map.yaml")


@pytest.mark.parametrize(
    ("image", "leaf"),
    [
        (b"", FileEmpty),
        (b"garbage", UnsupportedMedia),
        (_pgm(_room())[:-5000], FileTruncated),
        (b"P5\n60000 60000\n255\n", ImageTooLarge),
        (b"P5\n200 x\n255\n" + bytes(200), FileMalformed),
        (_pgm(np.full((50, 50), 254, dtype=np.uint8)), NoWallsFound),
    ],
)
def test_each_bad_image_has_its_own_problem(image: bytes, leaf: type[DomainError], tmp_path: Path) -> None:
    with pytest.raises(leaf):
        load_ros_map(_write(tmp_path, image=image))


def test_noise_is_no_map(tmp_path: Path) -> None:
    noise = np.where(np.random.default_rng(0).random((1500, 1500)) < 0.3, 0, 254).astype(np.uint8)
    with pytest.raises(DrawingTooComplex):
        load_ros_map(_write(tmp_path, image=_pgm(noise)))


YAML = (HEADER + THRESHOLDS).encode()


@pytest.mark.parametrize(
    ("members", "leaf"),
    [
        ([("map.yaml", YAML)], FileMalformed),
        ([("map.yaml", YAML), ("map.pgm", b"x"), ("c.txt", b"x")], FileMalformed),
        ([("map.yaml", YAML), ("../map.pgm", b"x")], FileMalformed),
        ([("map.yaml", YAML), ("/map.pgm", b"x")], FileMalformed),
        ([("a/map.yaml", YAML), ("a/../../map.pgm", b"x")], FileMalformed),
        ([("map.yaml", YAML), ("..\\map.pgm", b"x")], FileMalformed),
        ([("map.yaml", YAML), ("b/map.yaml", YAML), ("map.pgm", b"x")], FileMalformed),
        ([("a/map.yaml", YAML), ("a/other.pgm", b"x")], HeaderMismatch),
        ([("map.yaml", YAML), ("C:\\map.pgm", b"x")], FileMalformed),
        ([("map.yaml", YAML), ("other.pgm", b"x")], HeaderMismatch),
        ([("map.yaml", YAML), ("map.pgm", b"")], FileEmpty),
    ],
)
def test_each_bad_zip_has_its_own_problem(
    members: list[tuple[str, bytes]], leaf: type[DomainError], tmp_path: Path
) -> None:
    with pytest.raises(leaf):
        load_ros_map(_zip(tmp_path / "m.zip", *members))


def test_a_zip_bomb_is_refused_by_what_it_says_and_by_what_it_holds(tmp_path: Path) -> None:
    bounds = Bounds(max_zip_bytes=1 << 20)
    path = _zip(tmp_path / "m.zip", ("map.yaml", YAML), ("map.pgm", bytes(4 << 20)))
    with pytest.raises(ImageTooLarge):
        load_ros_map(path, bounds=bounds)
    packed = bytearray(path.read_bytes())
    real, said = (4 << 20).to_bytes(4, "little"), (1000).to_bytes(4, "little")
    lying = tmp_path / "lying.zip"
    lying.write_bytes(bytes(packed).replace(real, said))
    with pytest.raises((ImageTooLarge, FileTruncated, FileMalformed)):
        load_ros_map(lying, bounds=bounds)


def test_a_zip_that_is_cut_short_or_damaged_is_refused(tmp_path: Path) -> None:
    path = _zip(tmp_path / "m.zip", ("map.yaml", YAML), ("map.pgm", _pgm(_room())))
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    with pytest.raises(FileTruncated):
        load_ros_map(path)
    damaged = bytearray(whole)
    middle = whole.index(b"map.pgm") + 60
    damaged[middle : middle + 20] = bytes(20)
    path.write_bytes(bytes(damaged))
    with pytest.raises((FileTruncated, FileMalformed)):
        load_ros_map(path)


def test_a_bare_grid_is_a_sheet_that_says_what_it_is(tmp_path: Path) -> None:
    path = tmp_path / "map.pgm"
    path.write_bytes(_pgm(_room()))
    sheet = load_pgm(path)
    assert set(np.unique(sheet.grey).tolist()) == {0, 254, 255}
    assert [f.code for f in sheet.findings] == ["robot-map"]
    path.write_bytes(_pgm(np.tile(np.arange(200, dtype=np.uint8), (120, 1))))
    plain = load_pgm(path)
    assert plain.findings == ()
    assert plain.grey[0].tolist() == list(range(200))
