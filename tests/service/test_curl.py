"""A table of requests by curl, as an integrator types them: what is sent, and what has to come back."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests import files
from tests.server import ClientFor, Server
from tests.service.asking import a_map, a_ready_revision
from tests.service.by_hand import CLOUD, ByHand

SHA = hashlib.sha256(CLOUD).hexdigest()
PLY = files.ply(files.room(5_000))
PROBLEM = "application/problem+json"
A_PROBLEM = re.escape(PROBLEM)
CLOUD_AT = "$REVISION/artifacts/point-cloud.pcd"
TUS = "-H 'Tus-Resumable: 1.0.0'"
LENGTH = f"-H 'Upload-Length: {len(PLY)}'"
SAID = '-H "Upload-Metadata: map_id $MAP64,kind c2Nhbg==,filename ci5wbHk="'
UPPYS = (
    '-H "Upload-Metadata: relativePath bnVsbA==,name ci5wbHk=,type ,filetype ,map_id $MAP64,kind c2Nhbg=="'
)
PIECE = "-H 'Content-Type: application/offset+octet-stream'"


@pytest.fixture(scope="module")
def place(
    server: Server, admin: httpx.Client, by_hand: ByHand, client_for: ClientFor, tmp_path_factory: Any
) -> dict[str, str]:
    """Give what the lines call by name: the service, keys, a map with a ready revision, and files."""
    if shutil.which("curl") is None:
        pytest.skip("curl is not there: tools/setup --tests brings it")
    map_id = a_map(admin)
    n = a_ready_revision(admin, by_hand, map_id)
    folder = tmp_path_factory.mktemp("curl")
    (folder / "r.ply").write_bytes(PLY)
    (folder / "empty").write_bytes(b"")
    keys = {role: client_for(role).headers["authorization"] for role in ("admin", "tablet", "robot")}
    return {
        "SERVER": server.url,
        "MAP": map_id,
        "MAP64": base64.b64encode(map_id.encode()).decode(),
        "REVISION": f"{server.url}/v1/maps/{map_id}/revisions/{n}",
        "FOLDER": str(folder),
        **{role.upper(): f"Authorization: {key}" for role, key in keys.items()},
    }


@dataclass
class Answer:
    """An answer of curl: the last one's status, its headers by their small names, and the body."""

    status: int
    headers: dict[str, str]
    body: bytes = field(repr=False)


def curl(line: str, place: dict[str, str], folder: Path) -> Answer:
    """Return what comes back to the arguments of curl that a shell line holds."""
    body, head = folder / "body", folder / "head"
    body.write_bytes(b"")
    done = subprocess.run(
        ["bash", "-euc", f"curl -sS -D {head} -o {body} {line}"],
        env=os.environ | place,
        cwd=place["FOLDER"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{line}\n{done.stderr}"
    last = re.split(r"\r?\n\r?\n", head.read_text(encoding="latin-1").strip())[-1].splitlines()
    pairs = [row.partition(":") for row in last[1:]]
    headers: dict[str, str] = {}
    for name, _, value in pairs:
        small = name.lower()
        headers[small] = f"{headers[small]}, {value.strip()}" if small in headers else value.strip()
    return Answer(int(last[0].split()[1]), headers, body.read_bytes())


# what is sent; the status; what its headers hold (a pattern of all of the value, None: it is not there)
Row = tuple[str, int, dict[str, str | None]]
GET = f'-H "$ROBOT" {CLOUD_AT}'
WHOLE = {"etag": f'"{SHA}"', "accept-ranges": "bytes", "content-length": str(len(CLOUD))}
REFUSED: dict[str, str | None] = {"content-type": A_PROBLEM}
TABLE: dict[str, Row] = {
    "a file": (GET, 200, {**WHOLE, "content-encoding": None, "x-content-type-options": "nosniff"}),
    "its head": (f"-I {GET}", 200, dict(WHOLE)),
    "its first bytes": (
        f"-r 0-9 {GET}",
        206,
        {"content-range": f"bytes 0-9/{len(CLOUD)}", "etag": f'"{SHA}"'},
    ),
    "its last bytes": (f"-r -10 {GET}", 206, {"content-length": "10"}),
    "a range of the head": (f"-I -r 0-9 {GET}", 200, dict(WHOLE)),
    "bytes past its end": (
        f"-r 999999999- {GET}",
        416,
        {**REFUSED, "content-range": rf"bytes \*/{len(CLOUD)}"},
    ),
    "a range of the file at hand": (
        f"-r 5- -H 'If-Range: \"{SHA}\"' {GET}",
        206,
        {"content-range": "bytes 5-.*"},
    ),
    "a range of another file": (f"-r 5- -H 'If-Range: \"x\"' {GET}", 200, dict(WHOLE)),
    "two ranges": (f"-r 0-1,5-6 {GET}", 200, dict(WHOLE)),
    "what is at hand": (f"-H 'If-None-Match: \"{SHA}\"' {GET}", 304, {"etag": f'"{SHA}"', "vary": ".+"}),
    "this file alone": (f"-H 'If-Match: \"{SHA}\"' {GET}", 200, dict(WHOLE)),
    "another file alone": (f"-H 'If-Match: \"x\"' {GET}", 412, dict(REFUSED)),
    "a coded file": (f"-H 'Accept-Encoding: zstd' {GET}", 200, {"vary": ".*Accept-Encoding.*"}),
    "no coding at all": (f"-H 'Accept-Encoding: identity;q=0' {GET}", 406, dict(REFUSED)),
    "with no key": (CLOUD_AT, 401, {**REFUSED, "www-authenticate": "Bearer.*"}),
    "with a wrong key": (f"-H 'Authorization: Bearer x' {CLOUD_AT}", 401, {"www-authenticate": "Bearer.*"}),
    "what a robot may not": (
        '-H "$ROBOT" -X POST $SERVER/v1/maps --json \'{"site": "a", "name": "b"}\'',
        403,
        dict(REFUSED),
    ),
    "a map that is none": ('-H "$ADMIN" $SERVER/v1/maps/map_none', 404, dict(REFUSED)),
    "a file that is none": ('-H "$ROBOT" $REVISION/artifacts/none.pcd', 404, dict(REFUSED)),
    "a place that is none": ('-H "$ADMIN" $SERVER/v1/nothing/here', 404, dict(REFUSED)),
    "a way up and out": (
        '-H "$ROBOT" --path-as-is $REVISION/artifacts/../../../../etc/passwd',
        404,
        dict(REFUSED),
    ),
    "a method that is none here": (
        '-H "$ADMIN" -X DELETE $SERVER/v1/maps',
        405,
        {**REFUSED, "allow": "GET, HEAD, POST"},
    ),
    "a method of one's own": (
        '-H "$ADMIN" -X BREW $SERVER/v1/maps',
        405,
        {**REFUSED, "allow": "GET, HEAD, POST"},
    ),
    "a body of no JSON": ("-H \"$ADMIN\" $SERVER/v1/maps --json '{'", 422, dict(REFUSED)),
    "a body with an unknown field": (
        '-H "$ADMIN" $SERVER/v1/maps --json \'{"site": "a", "name": "b", "x": 1}\'',
        422,
        dict(REFUSED),
    ),
    "a body of another kind": (
        "-H \"$ADMIN\" $SERVER/v1/maps -H 'Content-Type: text/plain' -d 'site=a'",
        415,
        dict(REFUSED),
    ),
    "a form instead of JSON": ('-H "$ADMIN" $SERVER/v1/maps -d site=a -d name=b', 415, dict(REFUSED)),
    "a scan as a form": (
        '-H "$TABLET" $SERVER/v1/maps/$MAP/scans -F file=@r.ply',
        202,
        {"content-type": "application/json"},
    ),
    "a scan that is no file": ('-H "$TABLET" $SERVER/v1/maps/$MAP/scans -F file=@empty', 422, dict(REFUSED)),
    "what tus offers": (
        "-X OPTIONS $SERVER/v1/tus",
        204,
        {
            "tus-version": "1.0.0",
            "tus-extension": "creation.*",
            "tus-max-size": r"\d+",
            "tus-resumable": "1.0.0",
        },
    ),
    "an upload": (
        f'-H "$TABLET" -X POST $SERVER/v1/tus {TUS} {LENGTH} {SAID}',
        201,
        {"location": ".*/v1/tus/.+", "upload-expires": ".+GMT", "upload-offset": None},
    ),
    "an upload with metadata of Uppy": (
        f'-H "$TABLET" -X POST $SERVER/v1/tus {TUS} {LENGTH} {UPPYS}',
        201,
        {"location": ".*/v1/tus/.+"},
    ),
    "an upload with its bytes": (
        f'-H "$TABLET" $SERVER/v1/tus {TUS} {LENGTH} {SAID} {PIECE} --data-binary @r.ply',
        201,
        {
            "upload-offset": str(len(PLY)),
            "groundplan-result": "/v1/scans/.+",
            "groundplan-job": "/v1/jobs/.+",
        },
    ),
    "one part of an upload": (
        f"-H \"$TABLET\" -X POST $SERVER/v1/tus {TUS} {LENGTH} {SAID} -H 'Upload-Concat: partial'",
        400,
        {**REFUSED, "tus-resumable": "1.0.0"},
    ),
    "an upload of unknown length": (
        f"-H \"$TABLET\" -X POST $SERVER/v1/tus {TUS} {SAID} -H 'Upload-Defer-Length: 1'",
        400,
        dict(REFUSED),
    ),
    "an upload by another version": (
        f"-H \"$TABLET\" -X POST $SERVER/v1/tus -H 'Tus-Resumable: 0.2.2' {LENGTH} {SAID}",
        412,
        {**REFUSED, "tus-version": "1.0.0"},
    ),
    "an upload that is none": (
        f'-I -H "$TABLET" $SERVER/v1/tus/upl_none {TUS}',
        404,
        {"content-type": A_PROBLEM},
    ),
    "the head of a list": ('-I -H "$ADMIN" $SERVER/v1/maps', 200, {"content-type": "application/json"}),
    "how it is": ("$SERVER/healthz", 200, {}),
    "the document": ("$SERVER/openapi.json", 200, {"content-type": "application/json"}),
    "the page of a problem": ("$SERVER/problems/map-not-found", 200, {"content-type": "text/html.*"}),
}


@pytest.mark.parametrize("name", list(TABLE))
def test_the_table(name: str, place: dict[str, str], tmp_path: Path) -> None:
    line, status, told = TABLE[name]
    answer = curl(line, place, tmp_path)
    assert answer.status == status, (answer, answer.body[:500])
    for header, pattern in told.items():
        if pattern is None:
            assert header not in answer.headers, answer
        else:
            assert re.fullmatch(pattern, answer.headers.get(header, "")), (header, answer)
    if answer.headers.get("content-type") == PROBLEM and not line.startswith("-I"):
        problem = json.loads(answer.body)
        assert problem["status"] == status
        assert {"type", "title", "detail"} <= set(problem)
    assert answer.headers["x-request-id"]


def test_a_download_that_broke_goes_on(place: dict[str, str], tmp_path: Path) -> None:
    half = tmp_path / "half.pcd"
    half.write_bytes(CLOUD[: len(CLOUD) // 2])
    line = f'curl -sSf -C - -o {half} -H "$ROBOT" {CLOUD_AT}'
    subprocess.run(["bash", "-euc", line], env=os.environ | place, check=True)
    assert half.read_bytes() == CLOUD


@pytest.mark.parametrize(("case", "statuses"), [("47-tus-metadata", {201}), ("48-tus-concat", {400, 501})])
def test_the_collected_scripts(
    case: str, statuses: set[int], shared_cases: Path, place: dict[str, str], server: Server
) -> None:
    (script,) = (shared_cases / case).glob("*.sh")
    known = {"SERVER": server.url, "MAP": place["MAP"], "KEY": place["TABLET"].rpartition(" ")[2]}
    done = subprocess.run(
        ["bash", str(script)], env=os.environ | known, capture_output=True, text=True, check=True
    )
    assert int(done.stdout.split()[1]) in statuses, done.stdout
