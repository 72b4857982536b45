#!/usr/bin/env python3
"""Keep the map of a robot what its fleet should run: one file, the standard library of Python 3.10.

    groundplan_robot.py --server https://maps.example --map map_... --robot rob_... --folder /var/lib/map

polls what is published, fetches the least that gives the new point cloud (what it adds to the one at hand,
else the tiles that changed, else the whole file), verifies its SHA-256, swaps the map at once and whole,
and reports. The key is read from --key-file, or from the environment (GROUNDPLAN_KEY).

`FOLDER/current` is a link to the folder of the map in use: `point-cloud.pcd`, `manifest.json` and what
--also names. It is swapped in one step: whoever opens `current/point-cloud.pcd` gets the old map or the new
one, never a part. Killed at any instant, the next run goes on where this one was. A map in use that is
damaged on the robot's disk is noticed, and fetched again.

What a proxy or a login page answers instead of the service, or changes on the way, is no fault of the
revision: it is tried again, and not reported.
"""

from __future__ import annotations

import argparse
import hashlib
import http.client
import importlib
import json
import logging
import os
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

CLOUD, MANIFEST = "point-cloud.pcd", "manifest.json"
WAYS = ("delta", "tiles", "whole")
CHUNK_BYTES = 1 << 18
TIMEOUT_S = 20.0
TRIES = 5
DELTA_PATIENCE_S = 60.0
KEPT_REVISIONS = 2
CHECK_EVERY_S = 600.0
LONGEST_JSON_BYTES = 1 << 26
PAST_CACHES = {"Cache-Control": "no-cache", "Pragma": "no-cache"}
DATA_LINE = b"DATA binary\n"
BROKEN = (OSError, http.client.HTTPException)

log = logging.getLogger("groundplan-robot")


class NotDone(Exception):
    """One way of fetching, or one round, did not come to its end; the map in use stays as it is."""


class Unreachable(NotDone):
    """What the service has did not come, or not as it is: no fault of the revision, and tried again."""


@dataclass(frozen=True)
class File:
    """Hold a file as the service tells of it."""

    path: str
    sha256: str
    size_bytes: int
    url: str

    def __post_init__(self) -> None:
        """Refuse what is no SHA-256: the file lies under this name until it is verified."""
        if len(self.sha256) != 64 or not set(self.sha256) <= set("0123456789abcdef"):
            raise ValueError(f"{self.path} has no SHA-256")


@dataclass(frozen=True)
class Published:
    """Hold what is published: the revision, its cloud, all its files by path, and the tag of the answer."""

    n: int
    cloud: File
    files: dict[str, File]
    etag: str | None


class Straight(urllib.request.HTTPRedirectHandler):
    """Follow no redirects: the service has none, and whoever else sends one is not to get the key."""

    def redirect_request(self, *_told: Any) -> None:
        """Return nothing: the redirect is the answer."""


class Service:
    """Speak to the service: HTTP with the robot's key."""

    def __init__(self, url: str, key: str) -> None:
        self.url = url.rstrip("/")
        self._key = key
        self._opener = urllib.request.build_opener(Straight)

    def open(
        self,
        url: str,
        *,
        method: str = "GET",
        body: bytes | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> Any:
        """Return the open answer, also when it is a refusal."""
        address = urllib.parse.urljoin(self.url + "/", url)
        told = {"Authorization": f"Bearer {self._key}", "Accept-Encoding": "identity", **(headers or {})}
        request = urllib.request.Request(address, body, told, method=method)  # noqa: S310 - the operator's own
        try:
            return self._opener.open(request, timeout=TIMEOUT_S)
        except urllib.error.HTTPError as refusal:
            return refusal
        except (*BROKEN, ValueError) as reason:
            raise Unreachable(f"the service cannot be reached: {reason}") from reason

    def published(self, url: str, headers: Mapping[str, str]) -> Published | None:
        """Return what is published, or None if it is what `headers` say is known."""
        with self.open(url, headers=headers) as answer:
            text = b"".join(arriving(answer, LONGEST_JSON_BYTES))
            status, etag = answer.status, answer.headers.get("ETag")
        if status == 304 and headers:
            return None
        try:
            told = json.loads(text or b"{}")
            if status == 200:
                files = {file["path"]: as_file(file) for file in told["artifacts"]}
                return Published(int(told["revision"]), files[CLOUD], files, etag)
            detail = told.get("detail", "")
        except (ValueError, TypeError, KeyError, AttributeError) as reason:
            raise Unreachable(f"something answers {status}, and not as the service does") from reason
        raise Unreachable(f"the service answers {status}: {detail}")


class Folder:
    """Hold the maps of this robot on its disk."""

    def __init__(self, root: Path, *, check_every_s: float = CHECK_EVERY_S) -> None:
        self.root = root
        self.parts = root / "parts"
        self.revisions = root / "revisions"
        self._check_every_s = check_every_s
        self._checked: dict[str, object] = {}
        self._checked_at = float("-inf")
        for folder in (self.parts, self.revisions):
            folder.mkdir(parents=True, exist_ok=True)

    @property
    def current(self) -> Path:
        """Return the link to the map in use."""
        return self.root / "current"

    def state(self) -> dict[str, Any]:
        """Return what is remembered between runs."""
        try:
            found: dict[str, Any] = json.loads((self.root / "state.json").read_text(encoding="utf-8"))
            etag = found.setdefault("etag", None)
            sound = etag is None or (etag.isascii() and etag.isprintable())
            sound = sound and all(report["name"] and report["body"] for report in found["reports"])
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            sound = False
        return found if sound else {"reports": [], "etag": None}

    def remember(self, state: dict[str, Any]) -> None:
        """Keep what is to be remembered, whole or not at all."""
        write_whole(self.root / "state.json", json.dumps(state).encode())

    def told(self) -> dict[str, Any] | None:
        """Return what was written down with the map in use, or None if that cannot be read."""
        try:
            found: dict[str, Any] = json.loads((self.current / "revision.json").read_text(encoding="utf-8"))
            told = {"revision": int(found["revision"]), "sha256": str(found["sha256"])}
            return {
                **found,
                **told,
                "files": dict(found.get("files", {})),
                "asked": [*found.get("asked", ())],
            }
        except (OSError, ValueError, TypeError, KeyError):
            return None

    def held(self) -> dict[str, Any] | None:
        """Return what is known of the map in use, if its cloud is really there, bit for bit."""
        try:
            told = self.told()
            return told if told and sha256_of(self.current / CLOUD) == told["sha256"] else None
        except OSError:
            return None

    def damage(self) -> str | None:
        """Return what is wrong with the map in use, or None.

        Every file is read through when this process began, when the file system says that it is another
        than it was, and after `check_every_s`: a disk that forgets says nothing.
        """
        told = self.told()
        if told is None:
            return "what belongs to the map in use cannot be read"
        if time.monotonic() >= self._checked_at + self._check_every_s:
            self._checked, self._checked_at = {}, time.monotonic()
        for name, sha256 in {CLOUD: told["sha256"], **told["files"]}.items():
            try:
                seen = (self.current / name).stat()
                mark = (sha256, seen.st_dev, seen.st_ino, seen.st_size, seen.st_mtime_ns)
                if self._checked.get(name) != mark and sha256_of(self.current / name) != sha256:
                    return f"{name} has another SHA-256"
            except OSError as reason:
                return f"{name} cannot be read: {reason.strerror}"
            self._checked[name] = mark
        return None

    def install(self, n: int, files: Iterable[Path], told: dict[str, Any]) -> None:
        """Make verified files the map in use, in one step."""
        fresh = self.revisions / f"{n}-{uuid.uuid4().hex[:8]}"  # noqa: TID251 - a name, not an id of the service
        fresh.mkdir()
        for file in files:
            move(file, fresh / file.name)
        write_whole(fresh / "revision.json", json.dumps(told).encode())
        sync(fresh)
        link = self.root / "current.new"
        link.unlink(missing_ok=True)
        link.symlink_to(fresh.relative_to(self.root))
        move(link, self.current)
        sync(self.root)
        in_use = sorted(self.revisions.iterdir(), key=lambda path: path.stat().st_mtime)
        for old in [path for path in in_use if path != fresh][: -(KEPT_REVISIONS - 1)]:
            shutil.rmtree(old, ignore_errors=True)
        for part in self.parts.iterdir():
            part.unlink()


class Robot:
    """Follow one map.

    Parameters
    ----------
    service, folder
        Where maps come from, and where they go.
    map_id : str
        What is followed.
    channel : str, optional
        By default the one that the service has for the key's robot.
    robot_id : str, optional
        Under which to report; without it nothing is reported.
    also : sequence of str
        Further files of the revision to have, such as ``occupancy-grid.pgm``.
    ways : sequence of str
        How the cloud may be fetched, in the order of trying.
    """

    def __init__(
        self,
        service: Service,
        folder: Folder,
        *,
        map_id: str,
        channel: str | None = None,
        robot_id: str | None = None,
        also: Iterable[str] = (),
        ways: Iterable[str] = WAYS,
    ) -> None:
        self.service = service
        self.folder = folder
        self.map_id = map_id
        self.channel = channel
        self.robot_id = robot_id
        self.also = tuple(also)
        self.ways = tuple(ways)

    def run_once(self) -> bool:
        """Return whether the map in use is the published one, after doing what it takes.

        Raises
        ------
        NotDone, OSError
            If it cannot be had now; the map in use is what it was.
        """
        self.send_reports()
        etag, damage = self.folder.state()["etag"], None
        if self.folder.current.is_symlink():
            damage = self.folder.damage()
        if damage is not None:
            log.warning("the map in use is damaged and has to be fetched again: %s", damage)
        is_known = etag and damage is None and self.has_what_is_wanted()
        where = f"/v1/maps/{self.map_id}/published"
        if self.channel is not None:
            where += f"?channel={self.channel}"
        told = self.service.published(where, {"If-None-Match": etag} if is_known else {})
        if told is None:
            return True
        n = told.n
        try:
            way = self.update(n, told.files, damage)
        except Unreachable:
            raise
        except (NotDone, OSError) as reason:
            self.report(n, "failed", detail=str(reason))
            self.send_reports()
            raise
        self.folder.remember({**self.folder.state(), "etag": told.etag, "revision": n})
        log.info("revision %d is in use (%s)", n, way)
        self.send_reports()
        return True

    def has_what_is_wanted(self) -> bool:
        """Return whether the map in use is one of this map, and came with all that is wanted."""
        told = self.folder.told()
        return told is not None and told.get("map_id") == self.map_id and {*self.also} <= {*told["asked"]}

    def update(self, n: int, files: dict[str, File], damage: str | None = None) -> str:
        """Return by which way the cloud of revision `n` came; it is in use now.

        What was damaged of the map at hand goes with the report.
        """
        cloud = files[CLOUD]
        held = self.folder.held()
        fresh = self.folder.parts / CLOUD
        way = self.fetch(n, files, held, fresh)
        self.report(
            n, "downloaded", detail=f"{way}; the map at hand was damaged: {damage}" if damage else way
        )
        if sha256_of(fresh) != cloud.sha256:
            raise NotDone("the cloud that was put together has another SHA-256")
        self.report(n, "verified", sha256=cloud.sha256)
        wanted = {Path(path).name: files[path] for path in (MANIFEST, *self.also) if path in files}
        ready = [fresh, *(self.download(file, self.folder.parts / name) for name, file in wanted.items())]
        for file in ready:
            sync(file)
        told = {
            "revision": n,
            "sha256": cloud.sha256,
            "map_id": self.map_id,
            "way": way,
            "asked": self.also,
            "files": {name: file.sha256 for name, file in wanted.items()},
        }
        self.folder.install(n, ready, told)
        self.report(n, "enabled", sha256=cloud.sha256)
        return way

    def fetch(self, n: int, files: dict[str, File], held: dict[str, Any] | None, fresh: Path) -> str:
        """Return the way by which the cloud came to lie at `fresh`: the first that leads there."""
        if held is not None and held["sha256"] == files[CLOUD].sha256:
            shutil.copyfile(self.folder.current / CLOUD, fresh)
            return "held"
        ways: dict[str, Callable[[], object]] = {"whole": lambda: move(self.download(files[CLOUD]), fresh)}
        if held is not None and held.get("map_id") == self.map_id:
            ways["delta"] = lambda: self.by_delta(n, int(held["revision"]), files[CLOUD], fresh)
            ways["tiles"] = lambda: self.by_tiles(files, fresh)
        reasons: list[str] = []
        kind = NotDone
        for way in self.ways:
            if way not in ways:
                continue
            try:
                ways[way]()
                if sha256_of(fresh) == files[CLOUD].sha256:
                    return way
                reasons.append(f"{way}: another SHA-256")
            except (NotDone, OSError, ValueError, KeyError) as reason:
                reasons.append(f"{way}: {reason}")
                if way == "whole" or "whole" not in self.ways:
                    kind = Unreachable if isinstance(reason, Unreachable) else NotDone
            log.warning("%s", reasons[-1])
        raise kind("; ".join(reasons) or "no way of fetching is left")

    def by_delta(self, n: int, held_n: int, cloud: File, fresh: Path) -> None:
        """Write the cloud at `fresh` from the one at hand and what the new one adds to it."""
        if find_zstd() is None:
            raise NotDone("neither a zstd module nor the zstd program is here")
        where = f"/v1/maps/{self.map_id}/revisions/{n}/delta?from={held_n}"
        end = time.monotonic() + DELTA_PATIENCE_S
        while True:
            with self.service.open(where, method="HEAD") as told:
                status, wait_s = told.status, float(told.headers.get("Retry-After") or 0)
                size, etag = int(told.headers.get("Content-Length") or 0), told.headers.get("ETag") or ""
            if status != 503 or time.monotonic() + wait_s > end:
                break
            time.sleep(max(wait_s, 0.1))
        if status != 200:
            raise Unreachable(f"the service has no delta: it answers {status}")
        if size >= cloud.size_bytes:
            raise NotDone("the delta is no smaller than the whole cloud")
        delta = self.download(File("delta", etag.strip('"'), size, where))
        decode(self.folder.current / CLOUD, delta, fresh)
        delta.unlink()

    def by_tiles(self, files: dict[str, File], fresh: Path) -> None:
        """Write the cloud at `fresh` from tiles: those at hand are cut out of the cloud in use."""
        if self.folder.damage() is not None:
            raise NotDone("something of the map at hand is damaged")
        held_manifest = json.loads((self.folder.current / MANIFEST).read_text(encoding="utf-8"))
        manifest = json.loads(self.download(files[MANIFEST]).read_text(encoding="utf-8"))
        with (self.folder.current / CLOUD).open("rb") as held, fresh.open("wb") as sink:
            header = read_header(held)
            record_bytes = (os.fstat(held.fileno()).st_size - len(header)) // held_manifest["points"]
            places, at = {}, len(header)
            for tile in held_manifest["tiles"]:
                places[tile["sha256"]] = at
                at += tile["points"] * record_bytes
            sink.write(counted(header, held_manifest["points"], manifest["points"]))
            for tile in manifest["tiles"]:
                if tile["sha256"] in places:
                    held.seek(places[tile["sha256"]])
                    copy(held, sink, tile["points"] * record_bytes)
                else:
                    with self.download(files[tile["path"]]).open("rb") as fetched:
                        read_header(fetched)
                        shutil.copyfileobj(fetched, sink)
        for tile in manifest["tiles"]:
            (self.folder.parts / tile["sha256"]).unlink(missing_ok=True)

    def download(self, file: File, target: Path | None = None) -> Path:
        """Return where the verified bytes of a file lie; what had come of it before is not fetched again."""
        part = self.folder.parts / file.sha256
        for attempt in range(TRIES):
            try:
                self.download_rest(file, part, PAST_CACHES if attempt else {})
                break
            except Unreachable as reason:
                if attempt == TRIES - 1:
                    raise Unreachable(f"{file.path}: {reason}") from reason
                time.sleep(0.2 * 2**attempt)
        return part if target is None else move(part, target)

    def download_rest(self, file: File, part: Path, more: Mapping[str, str] | None = None) -> None:
        """Append to `part` what is missing of a file; what is not the file's bytes does not stay."""
        have = part.stat().st_size if part.exists() else 0
        if have < file.size_bytes:
            goes_on = {"Range": f"bytes={have}-", "If-Range": f'"{file.sha256}"'} if have else {}
            with self.service.open(file.url, headers={**goes_on, **(more or {})}) as answer:
                if answer.status not in (200, 206):
                    raise Unreachable(f"the service answers {answer.status}")
                going = goes_on and answer.status == 206
                with part.open("ab" if going else "wb") as sink:
                    for chunk in arriving(answer, file.size_bytes - (have if going else 0)):
                        sink.write(chunk)
            if part.stat().st_size < file.size_bytes:
                raise Unreachable(f"{part.stat().st_size} of {file.size_bytes} bytes came")
        if sha256_of(part) != file.sha256:
            part.unlink()
            raise Unreachable("it came with another SHA-256")

    def report(self, n: int, state: str, **more: str) -> None:
        """Keep a report until the service has taken it; each has a name, so that none counts twice."""
        if self.robot_id is None:
            return
        kept = self.folder.state()
        body = {"revision": n, "state": state, **more}
        kept["reports"] = [*kept.get("reports", []), {"name": str(uuid.uuid4()), "body": body}]  # noqa: TID251
        self.folder.remember(kept)

    def send_reports(self) -> None:
        """Send the reports that the service has not taken yet, in their order."""
        kept = self.folder.state()
        while kept.get("reports"):
            first = kept["reports"][0]
            try:
                with self.service.open(
                    f"/v1/robots/{self.robot_id}/reports",
                    method="POST",
                    body=json.dumps(first["body"]).encode(),
                    headers={"Content-Type": "application/json", "Idempotency-Key": first["name"]},
                ) as answer:
                    status, kind = answer.status, answer.headers.get_content_type()
            except Unreachable as reason:
                log.warning("the report waits: %s", reason)
                return
            refused = kind == "application/problem+json" and status < 500
            if status != 201 and (not refused or status in (401, 408, 429)):
                log.warning("the report waits: the service answers %d", status)
                return
            kept["reports"] = kept["reports"][1:]
            self.folder.remember(kept)


def find_zstd() -> Any:
    """Return a module that reads zstd with a prefix, or the path of the zstd program, or None."""
    for name in ("compression.zstd", "backports.zstd"):
        try:
            return importlib.import_module(name)
        except ImportError:
            continue
    return shutil.which("zstd")


def decode(old: Path, delta: Path, fresh: Path) -> None:
    """Write at `fresh` the file that `delta` gives to whoever has `old`."""
    zstd = find_zstd()
    if isinstance(zstd, str):
        command = [zstd, "-d", "-q", "-f", "--long=31", f"--patch-from={old.resolve()}", str(delta)]
        command += ["-o", str(fresh)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise NotDone(f"zstd could not read the delta: {done.stderr.strip()}")
        return
    options = {zstd.DecompressionParameter.window_log_max: 31}
    try:
        prefix = zstd.ZstdDict(old.read_bytes(), is_raw=True).as_prefix
        with zstd.open(delta, "rb", zstd_dict=prefix, options=options) as source, fresh.open("wb") as sink:
            shutil.copyfileobj(source, sink, CHUNK_BYTES)
    except (zstd.ZstdError, EOFError, MemoryError) as error:
        raise NotDone(f"the delta could not be read: {error or 'there is not enough memory'}") from error


def arriving(answer: Any, most: int) -> Iterator[bytes]:
    """Give the bytes of an answer as they come, at most so many."""
    while most:
        try:
            chunk = answer.read(min(CHUNK_BYTES, most))
        except BROKEN as reason:
            raise Unreachable(f"the answer broke off: {reason}") from reason
        if not chunk:
            return
        most -= len(chunk)
        yield chunk


def read_header(file: IO[bytes]) -> bytes:
    """Return the header of a PCD, read up to its records."""
    header = b""
    for line in file:
        header += line
        if line == DATA_LINE:
            return header
        if len(header) > CHUNK_BYTES:
            break
    raise NotDone("this is no binary PCD")


def counted(header: bytes, before: int, after: int) -> bytes:
    """Return a PCD's header with another number of points."""
    for name in (b"WIDTH", b"POINTS"):
        header = header.replace(b"%s %d\n" % (name, before), b"%s %d\n" % (name, after))
    return header


def copy(source: IO[bytes], sink: IO[bytes], count: int) -> None:
    """Copy that many bytes."""
    while count:
        chunk = source.read(min(count, CHUNK_BYTES))
        if not chunk:
            raise NotDone("the cloud in use is shorter than its manifest says")
        sink.write(chunk)
        count -= len(chunk)


def as_file(told: dict[str, Any]) -> File:
    """Return a file of the service's list."""
    return File(str(told["path"]), str(told["sha256"]), int(told["size_bytes"]), str(told["url"]))


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        for chunk in iter(lambda: file.read(CHUNK_BYTES), b""):
            digest.update(chunk)
    return digest.hexdigest()


def move(source: Path, target: Path) -> Path:
    """Return `target`, which the file is called now."""
    return source.replace(target)


def sync(path: Path) -> None:
    """Wait until the disk has a file, or the names in a folder."""
    fd = os.open(path, os.O_RDONLY)
    try:
        os.fsync(fd)
    finally:
        os.close(fd)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file that is there whole or not at all, also after a power cut."""
    fresh = path.with_name(path.name + ".new")
    fresh.write_bytes(content)
    sync(fresh)
    fresh.replace(path)


def follow(robot: Robot, every_s: float) -> None:
    """Go on for ever; what fails is tried again, later and later."""
    failed = 0
    while True:
        try:
            robot.run_once()
            failed = 0
        except (NotDone, OSError, ValueError) as reason:
            failed += 1
            log.warning("the map stays as it is: %s", reason)
        time.sleep(every_s * min(2**failed, 32) if failed else every_s)


def main(arguments: list[str] | None = None) -> int:
    """Return the exit status: 0 when the map in use is the published one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--server", required=True, help="address of the service")
    parser.add_argument("--map", required=True, help="id of the map to follow")
    parser.add_argument("--folder", required=True, type=Path, help="where maps are kept")
    parser.add_argument("--robot", help="id under which to report")
    parser.add_argument("--channel", help="follow this one, not that which the service has for the robot")
    parser.add_argument("--key-file", type=Path, help="file with the key; else GROUNDPLAN_KEY")
    parser.add_argument("--also", action="append", default=[], metavar="PATH", help="a further file to have")
    parser.add_argument("--ways", default=",".join(WAYS), help="how the cloud may be fetched, in order")
    parser.add_argument("--every", type=float, default=10.0, metavar="SECONDS", help="time between two polls")
    parser.add_argument(
        "--check-every",
        type=float,
        default=CHECK_EVERY_S,
        metavar="SECONDS",
        help="time between two readings of the whole map in use, which notice a damaged disk",
    )
    parser.add_argument("--once", action="store_true", help="poll once and end")
    asked = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    key = asked.key_file.read_text().strip() if asked.key_file else os.environ.get("GROUNDPLAN_KEY", "")
    robot = Robot(
        Service(asked.server, key),
        Folder(asked.folder, check_every_s=asked.check_every),
        map_id=asked.map,
        channel=asked.channel,
        robot_id=asked.robot,
        also=asked.also,
        ways=asked.ways.split(","),
    )
    if not asked.once:
        follow(robot, asked.every)
    try:
        return 0 if robot.run_once() else 1
    except (NotDone, OSError, ValueError) as reason:
        log.warning("the map stays as it is: %s", reason)
        return 1


if __name__ == "__main__":
    sys.exit(main())
