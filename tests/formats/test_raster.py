"""Raster files: every kind that a scanner or a CAD program writes, and the hostile ones."""

import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from service.domain.bounds import Bounds
from service.domain.errors import (
    FileEmpty,
    FileMalformed,
    FileTruncated,
    ImageTooLarge,
    PageNeeded,
    PageNotFound,
    UnsupportedMedia,
)
from worker.formats.raster import load_dpi, load_sheet
from worker.formats.tiff_pages import list_tiff_pages

MARK = np.full((40, 60), 255, dtype=np.uint8)
MARK[5:10, 10:30] = 0


def png_header(width: int, height: int, *, rows: bytes = b"") -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("suffix", "mode"),
    [
        *(("tiff", mode) for mode in ("1", "L", "P", "RGB", "RGBA", "LA", "CMYK")),
        *(("png", mode) for mode in ("1", "L", "P", "RGB", "RGBA", "LA")),
        *(("bmp", mode) for mode in ("1", "L", "P", "RGB")),
    ],
)
def test_every_mode_gives_the_same_grey(tmp_path: Path, suffix: str, mode: str) -> None:
    path = tmp_path / f"sheet.{suffix}"
    Image.fromarray(MARK).convert(mode).save(path)
    assert np.array_equal(load_sheet(path).grey, MARK)


def test_jpeg_and_jpeg_in_cmyk_are_read(tmp_path: Path) -> None:
    for mode in ("L", "RGB", "CMYK"):
        path = tmp_path / "sheet.jpg"
        Image.fromarray(MARK).convert(mode).save(path, quality=95)
        assert np.abs(load_sheet(path).grey.astype(int) - MARK).max() < 40


@pytest.mark.parametrize("suffix", ["png", "tiff"])
def test_sixteen_bits_keep_their_range(tmp_path: Path, suffix: str) -> None:
    wide = np.linspace(0, 65535, 2400).reshape(40, 60).astype(np.uint16)
    path = tmp_path / f"sheet.{suffix}"
    Image.fromarray(wide).save(path)
    assert np.abs(load_sheet(path).grey.astype(int) - wide // 257).max() <= 1


def test_a_pale_pen_is_as_dark_as_its_darkest_channel(tmp_path: Path) -> None:
    path = tmp_path / "cyan.png"
    Image.new("RGB", (4, 4), (40, 255, 255)).save(path)
    assert (load_sheet(path).grey == 40).all()


def test_transparency_lies_over_white(tmp_path: Path) -> None:
    path = tmp_path / "glass.png"
    glass = Image.new("RGBA", (3, 1), (0, 0, 0, 0))
    glass.putpixel((1, 0), (0, 0, 0, 255))
    glass.putpixel((2, 0), (0, 0, 0, 128))
    glass.save(path)
    assert load_sheet(path).grey.tolist() == [[255, 0, 127]]


def test_a_transparent_palette_entry_is_paper(tmp_path: Path) -> None:
    path = tmp_path / "palette.png"
    picture = Image.new("P", (2, 1), 0)
    picture.putpalette([0, 0, 0, 10, 10, 10])
    picture.putpixel((1, 0), 1)
    picture.save(path, transparency=0)
    assert load_sheet(path).grey.tolist() == [[255, 10]]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_exif_orientation_is_applied(tmp_path: Path, orientation: int) -> None:
    turns = {
        1: MARK,
        2: MARK[:, ::-1],
        3: MARK[::-1, ::-1],
        4: MARK[::-1],
        5: MARK.T,
        6: MARK.T[:, ::-1],
        7: MARK.T[::-1, ::-1],
        8: MARK.T[::-1],
    }
    exif = Image.Exif()
    exif[0x0112] = orientation
    path = tmp_path / "phone.png"
    Image.fromarray(MARK).save(path, exif=exif)
    assert np.array_equal(load_sheet(path).grey, turns[orientation])


def test_a_page_of_a_tiff_is_chosen(tmp_path: Path) -> None:
    path = tmp_path / "set.tiff"
    pages = [Image.fromarray(MARK), Image.fromarray(255 - MARK)]
    pages[0].save(path, save_all=True, append_images=pages[1:])
    assert np.array_equal(load_sheet(path, page=2).grey, 255 - MARK)
    with pytest.raises(PageNotFound) as refusal:
        load_sheet(path, page=3)
    assert refusal.value.members == {"pages": 2}


def test_the_stated_dpi_is_told(tmp_path: Path) -> None:
    path = tmp_path / "scan.png"
    Image.fromarray(MARK).save(path, dpi=(300, 300))
    assert load_dpi(path) == pytest.approx(300, abs=0.01)
    Image.fromarray(MARK).save(path)
    assert load_dpi(path) is None


def test_an_empty_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.png"
    path.write_bytes(b"")
    with pytest.raises(FileEmpty):
        load_sheet(path)


def test_a_text_file_named_png_is_refused_by_its_bytes(tmp_path: Path) -> None:
    path = tmp_path / "notes.png"
    path.write_text("the drawing follows by mail\n" * 10)
    with pytest.raises(UnsupportedMedia):
        load_sheet(path)


@pytest.mark.parametrize("suffix", ["png", "jpg", "tiff", "bmp", "webp"])
def test_a_cut_file_is_refused_wherever_it_was_cut(tmp_path: Path, suffix: str) -> None:
    whole = tmp_path / f"whole.{suffix}"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (200, 300), dtype=np.uint8)).save(whole)
    content = whole.read_bytes()
    for share in (0.001, 0.01, 0.3, 0.6, 0.9):
        cut = tmp_path / f"cut.{suffix}"
        cut.write_bytes(content[: max(12, int(len(content) * share))])
        with pytest.raises((FileTruncated, FileMalformed)):
            load_sheet(cut)


def test_png_cut_in_its_pixels_is_called_truncated(tmp_path: Path) -> None:
    whole = tmp_path / "whole.png"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (200, 300), dtype=np.uint8)).save(whole)
    cut = tmp_path / "cut.png"
    cut.write_bytes(whole.read_bytes()[:20_000])
    with pytest.raises(FileTruncated):
        load_sheet(cut)


@pytest.mark.parametrize("seed", range(20))
def test_flipped_bytes_are_read_or_refused_never_a_crash(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    for suffix in ("png", "jpg", "tiff", "bmp", "webp"):
        path = tmp_path / f"flip.{suffix}"
        Image.fromarray(MARK).save(path)
        content = bytearray(path.read_bytes())
        for at in rng.integers(8, len(content), 5):
            content[at] = rng.integers(256)
        path.write_bytes(content)
        try:
            load_sheet(path, bounds=Bounds(max_pixels=10_000_000))
        except (FileTruncated, FileMalformed, ImageTooLarge, FileEmpty, UnsupportedMedia):
            continue


def test_a_header_of_3600_megapixels_is_refused_with_the_limit(tmp_path: Path) -> None:
    path = tmp_path / "bomb.png"
    path.write_bytes(png_header(60_000, 60_000))
    with pytest.raises(ImageTooLarge) as refusal:
        load_sheet(path)
    assert refusal.value.members == {"max_pixels": 200_000_000, "width": 60_000, "height": 60_000}


def test_a_bomb_whose_pixels_are_all_there_is_not_decoded(tmp_path: Path) -> None:
    path = tmp_path / "bomb.png"
    squeezer = zlib.compressobj(1)
    row = b"\x00" * 60_001
    rows = b"".join(squeezer.compress(row) for _ in range(60_000)) + squeezer.flush()
    path.write_bytes(png_header(60_000, 60_000, rows=rows))
    code = (
        "import sys; from pathlib import Path\n"
        "from worker.formats.raster import load_sheet\n"
        "from service.domain.errors import ImageTooLarge\n"
        "try:\n    load_sheet(Path(sys.argv[1])).grey\n"
        "except ImageTooLarge:\n"
        "    status = Path('/proc/self/status').read_text()\n"
        "    print(status.split('VmHWM:')[1].split()[0])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True, cwd=Path.cwd()
    )
    assert int(done.stdout) * 1024 < 200 * 2**20


def test_a_sheet_of_65_megapixels_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a0.png"
    Image.new("1", (10_000, 6_500), 1).save(path)
    assert load_sheet(path).grey.shape == (6_500, 10_000)


def three_pages(path: Path) -> None:
    pages = [Image.fromarray(MARK), Image.fromarray(255 - MARK), Image.new("L", (30, 20), 255)]
    pages[0].save(path, save_all=True, append_images=pages[1:])


def test_several_pages_are_listed_and_none_is_guessed(tmp_path: Path) -> None:
    path = tmp_path / "set.tiff"
    three_pages(path)
    with pytest.raises(PageNeeded, match="3 pages") as refusal:
        load_sheet(path)
    assert refusal.value.members == {
        "page_count": 3,
        "pages": [
            {"page": 1, "width_px": 60, "height_px": 40},
            {"page": 2, "width_px": 60, "height_px": 40},
            {"page": 3, "width_px": 30, "height_px": 20},
        ],
    }
    sheet = load_sheet(path, page=3)
    assert sheet.grey.shape == (20, 30)
    assert [f.code for f in sheet.findings] == ["page-of-several"]


def test_the_only_page_needs_no_number_and_other_kinds_have_one(tmp_path: Path) -> None:
    Image.fromarray(MARK).save(tmp_path / "one.tiff")
    assert load_sheet(tmp_path / "one.tiff").findings == ()
    Image.fromarray(MARK).save(tmp_path / "one.png")
    assert np.array_equal(load_sheet(tmp_path / "one.png", page=1).grey, MARK)
    with pytest.raises(PageNotFound):
        load_sheet(tmp_path / "one.png", page=2)


@pytest.mark.parametrize("big", [False, True])
def test_the_pages_of_classic_and_big_tiffs_are_walked(tmp_path: Path, *, big: bool) -> None:
    path = tmp_path / "set.tiff"
    pages = [Image.fromarray(MARK), Image.fromarray(255 - MARK)]
    pages[0].save(path, save_all=True, append_images=pages[1:], big_tiff=big)
    assert [(p.directory, p.width, p.height) for p in list_tiff_pages(path)] == [(0, 60, 40), (1, 60, 40)]


def test_a_thumbnail_is_no_page(tmp_path: Path) -> None:
    path = tmp_path / "thumb.tiff"
    Image.new("L", (6, 4), 255).save(
        path, save_all=True, append_images=[Image.fromarray(MARK)], tiffinfo={254: 0}
    )
    content = bytearray(path.read_bytes())
    first = struct.unpack_from("<I", content, 4)[0]
    entries = [first + 2 + 12 * i for i in range(struct.unpack_from("<H", content, first)[0])]
    at = next(e for e in entries if struct.unpack_from("<H", content, e)[0] == 254)
    struct.pack_into("<I", content, at + 8, 1)
    path.write_bytes(content)
    assert [(p.directory, p.width) for p in list_tiff_pages(path)] == [(1, 60)]
    assert np.array_equal(load_sheet(path).grey, MARK)


def test_directories_that_go_in_a_circle_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "circle.tiff"
    Image.fromarray(MARK).save(path)
    content = bytearray(path.read_bytes())
    first = struct.unpack_from("<I", content, 4)[0]
    count = struct.unpack_from("<H", content, first)[0]
    struct.pack_into("<I", content, first + 2 + 12 * count, first)
    path.write_bytes(content)
    with pytest.raises(FileMalformed, match="circle"):
        load_sheet(path)


def tiff_header(entries: list[tuple[int, int, int, int]]) -> bytes:
    body = b"".join(struct.pack("<HHII", *entry) for entry in sorted(entries))
    return b"II*\x00" + struct.pack("<IH", 8, len(entries)) + body + struct.pack("<I", 0) + bytes(64)


@pytest.mark.parametrize(
    "extra",
    [
        [(256, 4, 1, 60_000), (257, 4, 1, 60_000), (273, 4, 1, 8), (279, 4, 1, 64)],
        [
            (256, 4, 1, 90),
            (257, 4, 1, 90),
            (322, 4, 1, 60_000),
            (323, 4, 1, 60_000),
            (324, 4, 1, 8),
            (325, 4, 1, 64),
        ],
    ],
    ids=["sheet", "tile"],
)
def test_a_tiff_bomb_is_refused_by_its_header(tmp_path: Path, extra: list[tuple[int, int, int, int]]) -> None:
    path = tmp_path / "bomb.tiff"
    path.write_bytes(tiff_header([(258, 3, 1, 8), (259, 3, 1, 8), (262, 3, 1, 1), (277, 3, 1, 1), *extra]))
    with pytest.raises(ImageTooLarge):
        load_sheet(path)


def test_webp_is_read_and_a_cut_one_is_called_truncated(tmp_path: Path) -> None:
    path = tmp_path / "sheet.webp"
    Image.fromarray(MARK).convert("RGB").save(path, lossless=True)
    assert np.array_equal(load_sheet(path).grey, MARK)
    cut = tmp_path / "cut.webp"
    cut.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(FileTruncated):
        load_sheet(cut)


def test_a_sound_file_is_no_image(tmp_path: Path) -> None:
    path = tmp_path / "sound.webp"
    path.write_bytes(b"RIFF" + struct.pack("<I", 4) + b"WAVE")
    with pytest.raises(UnsupportedMedia):
        load_sheet(path)


@pytest.mark.parametrize("suffix", ["jpg", "tiff", "webp"])
def test_a_turned_photograph_is_set_upright_in_every_kind(tmp_path: Path, suffix: str) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    path = tmp_path / f"phone.{suffix}"
    Image.fromarray(MARK).convert("RGB").save(path, exif=exif, quality=95)
    sheet = load_sheet(path)
    assert sheet.grey.shape == (60, 40)
    assert np.abs(sheet.grey.astype(int) - MARK.T[:, ::-1]).max() < 40
    assert [f.code for f in sheet.findings] == ["picture-turned"]


def test_pixels_that_are_not_square_are_a_finding(tmp_path: Path) -> None:
    path = tmp_path / "fax.tiff"
    Image.fromarray(MARK).save(path, dpi=(204, 98))
    sheet = load_sheet(path)
    assert sheet.dpi is None
    assert [f.code for f in sheet.findings] == ["pixels-not-square"]
    Image.fromarray(MARK).save(path, dpi=(300, 300))
    assert load_sheet(path).dpi == pytest.approx(300)
