#!/usr/bin/env python3
"""Keep the map of a robot what its fleet should run: one file, the standard library of Python 3.10.

    groundplan_robot.py --server https://maps.example --map map_... --robot rob_... --folder /var/lib/map

polls what is published, fetches the least that gives the new point cloud (what it adds to the one at hand,
else the tiles that changed, else the whole file), verifies its SHA-256, swaps the map at once and whole,
and reports. The key is read from --key-file, or from the environment (GROUNDPLAN_KEY).

`FOLDER/current` is a link to the folder of the map in use: `point-cloud.pcd`, `manifest.json` and what
--also names. It is swapped in one step: whoever opens `current/point-cloud.pcd` gets the old map or the new
one, never a part. Killed at any instant, the next run goes on where this one was.
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
from collections.abc import Callable, Iterable, Mapping
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
DATA_LINE = b"DATA binary\n"
BROKEN = (urllib.error.URLError, ConnectionError, TimeoutError, http.client.HTTPException)

log = logging.getLogger("groundplan-robot")


class NotDone(Exception):
    """One way of fetching, or one round, did not come to its end; the map in use stays as it is."""


class Unreachable(NotDone):
    """The service did not answer, or not in full: no fault of the revision, and tried again."""


@dataclass(frozen=True)
class File:
    """Hold a file as the service tells of it."""

    path: str
    sha256: str
    size_bytes: int
    url: str


class Service:
    """Speak to the service: HTTP with the robot's key."""

    def __init__(self, url: str, key: str) -> None:
        self.url = url.rstrip("/")
        self._key = key

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
            return urllib.request.urlopen(request, timeout=TIMEOUT_S)  # noqa: S310 - as above
        except urllib.error.HTTPError as refusal:
            return refusal
        except BROKEN as reason:
            raise Unreachable(f"the service cannot be reached: {reason}") from reason

    def json(self, url: str, headers: Mapping[str, str]) -> tuple[int, dict[str, Any], str | None]:
        """Return status, body and ETag of an answer."""
        with self.open(url, headers=headers) as answer:
            try:
                text = answer.read()
            except BROKEN as reason:
                raise Unreachable(f"the answer broke off: {reason}") from reason
            etag: str | None = answer.headers.get("ETag")
            return answer.status, json.loads(text) if text else {}, etag


class Folder:
    """Hold the maps of this robot on its disk."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.parts = root / "parts"
        self.revisions = root / "revisions"
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
        except (FileNotFoundError, ValueError):
            return {"reports": []}
        return found

    def remember(self, state: dict[str, Any]) -> None:
        """Keep what is to be remembered, whole or not at all."""
        write_whole(self.root / "state.json", json.dumps(state).encode())

    def held(self) -> dict[str, Any] | None:
        """Return what is known of the map in use, if its cloud is really there, bit for bit."""
        try:
            told: dict[str, Any] = json.loads((self.current / "revision.json").read_text(encoding="utf-8"))
            return told if sha256_of(self.current / CLOUD) == told["sha256"] else None
        except (OSError, ValueError, KeyError):
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
        state = self.folder.state()
        where = f"/v1/maps/{self.map_id}/published"
        if self.channel is not None:
            where += f"?channel={self.channel}"
        etag = state.get("etag")
        known = {"If-None-Match": etag} if etag and self.folder.current.exists() else {}
        status, told, etag = self.service.json(where, known)
        if status == 304:
            return True
        if status != 200:
            raise Unreachable(f"the service answers {status}: {told.get('detail', '')}")
        n = int(told["revision"])
        try:
            way = self.update(n, {file["path"]: as_file(file) for file in told["artifacts"]})
        except Unreachable:
            raise
        except (NotDone, OSError) as reason:
            self.report(n, "failed", detail=str(reason))
            self.send_reports()
            raise
        self.folder.remember({**self.folder.state(), "etag": etag, "revision": n})
        log.info("revision %d is in use (%s)", n, way)
        self.send_reports()
        return True

    def update(self, n: int, files: dict[str, File]) -> str:
        """Return by which way the cloud of revision `n` came; it is in use now."""
        cloud = files[CLOUD]
        held = self.folder.held()
        fresh = self.folder.parts / CLOUD
        way = self.fetch(n, files, held, fresh)
        self.report(n, "downloaded", detail=way)
        if sha256_of(fresh) != cloud.sha256:
            raise NotDone("the cloud that was put together has another SHA-256")
        self.report(n, "verified", sha256=cloud.sha256)
        wanted = [files[path] for path in (MANIFEST, *self.also) if path in files]
        ready = [fresh, *(self.download(file, self.folder.parts / Path(file.path).name) for file in wanted)]
        for file in ready:
            sync(file)
        told = {"revision": n, "sha256": cloud.sha256, "map_id": self.map_id, "way": way}
        self.folder.install(n, ready, told)
        self.report(n, "enabled", sha256=cloud.sha256)
        return way

    def fetch(self, n: int, files: dict[str, File], held: dict[str, Any] | None, fresh: Path) -> str:
        """Return the way by which the cloud came to lie at `fresh`: the first that leads there."""
        if held is not None and held["sha256"] == files[CLOUD].sha256:
            shutil.copyfile(self.folder.current / CLOUD, fresh)
            return "held"
        ways: dict[str, Callable[[], object]] = {"whole": lambda: move(self.download(files[CLOUD]), fresh)}
        if held is not None and held["map_id"] == self.map_id:
            ways["delta"] = lambda: self.by_delta(n, int(held["revision"]), files[CLOUD], fresh)
            ways["tiles"] = lambda: self.by_tiles(files, fresh)
        reasons, kind = [], NotDone
        for way in self.ways:
            if way not in ways:
                continue
            try:
                ways[way]()
                if sha256_of(fresh) == files[CLOUD].sha256:
                    return way
                reasons.append(f"{way}: another SHA-256")
                kind = NotDone
            except (NotDone, OSError, ValueError, KeyError) as reason:
                reasons.append(f"{way}: {reason}")
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
            raise NotDone(f"the service has no delta: it answers {status}")
        if size >= cloud.size_bytes:
            raise NotDone("the delta is no smaller than the whole cloud")
        delta = self.download(File("delta", etag.strip('"'), size, where))
        decode(self.folder.current / CLOUD, delta, fresh)
        delta.unlink()

    def by_tiles(self, files: dict[str, File], fresh: Path) -> None:
        """Write the cloud at `fresh` from tiles: those at hand are cut out of the cloud in use."""
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
                self.download_rest(file, part)
                break
            except Unreachable as reason:
                if attempt == TRIES - 1:
                    raise Unreachable(f"{file.path}: {reason}") from reason
                time.sleep(0.2 * 2**attempt)
        if sha256_of(part) != file.sha256:
            part.unlink()
            raise NotDone(f"{file.path} came with another SHA-256")
        return part if target is None else move(part, target)

    def download_rest(self, file: File, part: Path) -> None:
        """Append to `part` what is missing of a file."""
        have = part.stat().st_size if part.exists() else 0
        if have == file.size_bytes:
            return
        goes_on = 0 < have < file.size_bytes
        asked = {"Range": f"bytes={have}-", "If-Range": f'"{file.sha256}"'} if goes_on else {}
        with self.service.open(file.url, headers=asked) as answer:
            if answer.status not in (200, 206):
                raise (Unreachable if answer.status >= 500 else NotDone)(
                    f"the service answers {answer.status}"
                )
            with part.open("ab" if answer.status == 206 else "wb") as sink:
                try:
                    shutil.copyfileobj(answer, sink, CHUNK_BYTES)
                except BROKEN as reason:
                    raise Unreachable(f"the download broke off: {reason}") from reason
        if part.stat().st_size != file.size_bytes:
            raise Unreachable(f"{part.stat().st_size} of {file.size_bytes} bytes came")

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
                    status = answer.status
            except Unreachable as reason:
                log.warning("the report waits: %s", reason)
                return
            if status >= 500 or status in (401, 408, 429):
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
    return File(told["path"], told["sha256"], told["size_bytes"], told["url"])


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
    parser.add_argument("--once", action="store_true", help="poll once and end")
    asked = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s", stream=sys.stderr)
    key = asked.key_file.read_text().strip() if asked.key_file else os.environ.get("GROUNDPLAN_KEY", "")
    robot = Robot(
        Service(asked.server, key),
        Folder(asked.folder),
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
