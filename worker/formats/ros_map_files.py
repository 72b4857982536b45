"""The two files of a ROS map: where its YAML lies, and the image that it names by whatever path."""

from __future__ import annotations

import lzma
import re
import unicodedata
import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from service.domain.bounds import Bounds
from service.domain.errors import FileEncrypted, FileMalformed, FileTruncated, HeaderMismatch, ImageTooLarge

_YAML = (".yaml", ".yml")
_MOST_ENTRIES = 64
_BY_THE_WAY = re.compile(r"(^|/)(__MACOSX/|\._|\.DS_Store$|Thumbs\.db$|desktop\.ini$)", re.IGNORECASE)
_FROM_ELSEWHERE = re.compile(r"/|~|[A-Za-z]:|[A-Za-z][A-Za-z0-9+.-]+://")
_IS_UTF8 = 0x800
_OLD_NAMES = ("utf-8", "cp932")


def map_files(path: Path, bounds: Bounds) -> _Folder | _Pair:
    """Return the files of a map: a ``map.yaml`` and what lies beside it, or a ZIP of both.

    The image is found by its name, however the YAML writes the way to it: ``map_saver`` writes where it lay
    on the robot. A path within the YAML's folder is followed; none leads out of it.

    Returns
    -------
    object
        With the YAML's `name` and `text`; its `image` takes what the YAML calls it, and gives the bytes.

    Raises
    ------
    FileMalformed, FileEncrypted, FileTruncated
        If the ZIP breaks its rules, has a password, or is cut short.
    ImageTooLarge
        If it holds more bytes than are read.
    """
    with path.open("rb") as file:
        zipped = file.read(4) == b"PK\x03\x04"
    return _from_zip(path, bounds) if zipped else _Folder(path, bounds)


def parts_of(said: object, name: str) -> list[str]:
    """Return the folders and the name of an image as the YAML `name` writes it, without a way from elsewhere.

    Raises
    ------
    FileMalformed
        If it names no file, or one outside of the YAML's folder.
    """
    if not isinstance(said, str) or not said.isprintable():
        raise FileMalformed(f"{name} names its image {str(said)[:80]!r}, which is no name of a file.")
    way = said.replace("\\", "/")
    parts = [part for part in way.split("/") if part not in ("", ".")]
    if ".." in parts:
        raise FileMalformed(
            f"{name} names its image {said[:80]!r}, which leads out of its folder. Put the image beside the "
            "YAML, and write its plain name there."
        )
    if _FROM_ELSEWHERE.match(way):
        parts = [re.sub("^[A-Za-z]:", "", part) for part in parts[-1:]]
    if not parts or not parts[-1] or way.endswith("/"):
        raise FileMalformed(f"{name} names its image {said[:80]!r}, which is no name of a file.")
    return parts


class _Folder:
    """A map's YAML in a folder, among other files."""

    def __init__(self, path: Path, bounds: Bounds) -> None:
        self.name = path.name
        with path.open("rb") as file:
            self.text = file.read(bounds.max_yaml_bytes + 1)
        self._path, self._bounds = path, bounds

    def image(self, said: str) -> bytes:
        """Return the image in this folder or one below it; the nearest of that name."""
        parts = parts_of(said, self.name)
        if self._path.suffix.lower() not in _YAML:
            raise HeaderMismatch(
                f"The map.yaml came without its image {said[:80]!r}: send a ZIP that holds both.",
                image=said[:200],
            )
        folder = self._path.parent
        found = _found(folder, parts) or _found(folder, parts[-1:])
        if found is None or not found.resolve().is_relative_to(folder.resolve()):
            raise HeaderMismatch(
                f"{self.name} names the image {said[:80]!r}, and no {parts[-1]!r} lies beside it. Put it in "
                "the same folder; to upload a map, send a ZIP of both.",
                image=said[:200],
            )
        size = found.stat().st_size
        if size > self._bounds.max_zip_bytes:
            raise _too_many_bytes(found.name, size, self._bounds)
        return found.read_bytes()


def _found(folder: Path, parts: Iterable[str]) -> Path | None:
    """Return the file that lies so many folders down; of names in other letters the only one."""
    for part in parts:
        exact = folder / part
        alike = [exact] if exact.exists() else []
        if not alike and folder.is_dir():
            alike = [p for p in folder.iterdir() if _plain(p.name) == _plain(part)]
        if len(alike) != 1:
            return None
        folder = alike[0]
    return folder if folder.is_file() else None


@dataclass(frozen=True)
class _Pair:
    """A map's YAML and the only other file of its ZIP, with the names that it may have."""

    name: str
    text: bytes
    other: tuple[str, ...]
    content: bytes

    def image(self, said: str) -> bytes:
        """Return the image, if the YAML names it."""
        wanted = parts_of(said, self.name)[-1]
        if _plain(wanted) not in {_plain(name.rpartition("/")[2]) for name in self.other}:
            raise HeaderMismatch(
                f"{self.name} names the image {said[:80]!r}, and the ZIP holds {self.other[0][:80]!r}.",
                image=said[:200],
            )
        return self.content


def _from_zip(path: Path, bounds: Bounds) -> _Pair:
    try:
        with zipfile.ZipFile(path) as archive:
            one, other = _two_entries(archive.infolist(), path, bounds)
            text, content = (_unpack(archive, entry, bounds) for entry in (one, other))
            return _Pair(one.filename, text, _names_of(other), content)
    except (zipfile.BadZipFile, zipfile.LargeZipFile, EOFError) as error:
        raise FileTruncated(f"{path.name} is no whole ZIP: {error}. Upload it again.") from error
    except (NotImplementedError, RuntimeError, ValueError, OSError, zlib.error, lzma.LZMAError) as error:
        raise FileMalformed(f"{path.name} cannot be unpacked: {error}.") from error


def _two_entries(
    entries: list[zipfile.ZipInfo], path: Path, bounds: Bounds
) -> tuple[zipfile.ZipInfo, zipfile.ZipInfo]:
    """Return the YAML and the image of a ZIP that holds exactly these, in folders or not."""
    for entry in entries[:_MOST_ENTRIES]:
        way = entry.filename.replace("\\", "/")
        if ".." in way.split("/") or _FROM_ELSEWHERE.match(way) or not way.isprintable():
            raise FileMalformed(f"{path.name} holds {entry.filename[:80]!r}, which leads out of it.")
        if entry.flag_bits & 1:
            raise FileEncrypted(f"{path.name} is encrypted; pack it without a password.")
    files = [e for e in entries if not e.is_dir() and not _BY_THE_WAY.search(e.filename)]
    of_yaml = [e for e in files if e.filename.lower().endswith(_YAML)]
    if len(entries) > _MOST_ENTRIES or len(files) != 2 or len(of_yaml) != 1:
        raise FileMalformed(
            f"{path.name} holds {len(files)} files, {len(of_yaml)} of them YAML; a ZIP of a ROS map holds "
            "its YAML and its image and nothing else."
        )
    size = sum(e.file_size for e in files)
    if size > bounds.max_zip_bytes:
        raise _too_many_bytes(path.name, size, bounds)
    return of_yaml[0], files[1 - files.index(of_yaml[0])]


def _names_of(entry: zipfile.ZipInfo) -> tuple[str, ...]:
    """Return what an entry is called: where the ZIP does not say that it is UTF-8, also by what it may be."""
    names = [entry.filename]
    if not entry.flag_bits & _IS_UTF8:
        for encoding in _OLD_NAMES:
            try:
                names.append(entry.filename.encode("cp437").decode(encoding))
            except UnicodeError:
                continue
    return tuple(name.replace("\\", "/") for name in names)


def _unpack(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, bounds: Bounds) -> bytes:
    """Return the bytes of an entry, never more than its header or the bound says."""
    with archive.open(entry) as file:
        unpacked = file.read(bounds.max_zip_bytes + 1)
    if len(unpacked) > bounds.max_zip_bytes:
        raise _too_many_bytes(entry.filename, len(unpacked), bounds)
    return unpacked


def _too_many_bytes(name: str, size: int, bounds: Bounds) -> ImageTooLarge:
    return ImageTooLarge(
        f"{name} has {size} bytes unpacked; at most {bounds.max_zip_bytes} are read.",
        max_bytes=bounds.max_zip_bytes,
    )


def _plain(name: str) -> str:
    """Return a name as systems that tell no capitals apart, or write accents as two signs, compare it."""
    return unicodedata.normalize("NFC", name).casefold()
