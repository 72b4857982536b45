"""A revision's files for robots: a manifest of them, one package of all, and the large ones compressed."""

from __future__ import annotations

import hashlib
import tarfile
from collections.abc import Sequence
from pathlib import Path

from backports import zstd

from worker.formats.reading import write_json
from worker.formats.tiles import TILE_SIZE_M, Tile

CODED_SUFFIX = ".zst"
_LEVEL = 3
_READ_BYTES = 1 << 20


def write_manifest(directory: Path, files: Sequence[Path], tiles: Sequence[Tile], *, points: int) -> Path:
    """Write ``manifest.json``: every file with its SHA-256, and the tiles in the order of the cloud's points.

    Parameters
    ----------
    directory : Path
        Holds the files.
    files : sequence of Path
        What the manifest tells of; the cloud and the tiles are among them.
    tiles : sequence of Tile
        As `write_tiles` returned them.
    points : int
        How many points the cloud has.
    """
    path = directory / "manifest.json"
    manifest = {
        "format": "groundplan-manifest/1",
        "frame": "map",
        "points": points,
        "tile_size_m": TILE_SIZE_M,
        "tiles": [tile.to_json() for tile in tiles],
        "files": [
            {
                "path": name,
                "sha256": _sha256(directory / name),
                "size_bytes": (directory / name).stat().st_size,
            }
            for name in sorted(file.relative_to(directory).as_posix() for file in files)
        ],
    }
    write_json(path, manifest)
    return path


def write_package(directory: Path, manifest: Path, files: Sequence[Path]) -> Path:
    """Write ``package.tar``: the manifest, then every file it tells of, by path; same files, same bytes.

    Not compressed, so that a robot can verify and use each member where it lies. Plain USTAR without owner,
    clock or rights of this machine.
    """
    path = directory / "package.tar"
    with tarfile.open(path, "w", format=tarfile.USTAR_FORMAT) as package:
        for file in [manifest, *sorted(files, key=lambda file: file.relative_to(directory).as_posix())]:
            member = tarfile.TarInfo(file.relative_to(directory).as_posix())
            member.size, member.mode = file.stat().st_size, 0o644
            with file.open("rb") as content:
                package.addfile(member, content)
    return path


def write_coded(path: Path) -> Path:
    """Write the file once more, compressed by zstd, as ``<name>.zst`` beside it; same file, same bytes."""
    coded = path.with_name(path.name + CODED_SUFFIX)
    parameter = zstd.CompressionParameter
    options: dict[int, int] = {parameter.compression_level: _LEVEL, parameter.checksum_flag: 1}
    compressor = zstd.ZstdCompressor(options=options)
    compressor.set_pledged_input_size(path.stat().st_size)
    with path.open("rb") as source, coded.open("wb") as sink:
        while chunk := source.read(_READ_BYTES):
            sink.write(compressor.compress(chunk))
        sink.write(compressor.flush())
    return coded


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
