"""Text that is none, through every door where text of a file comes in: nothing of it harms others."""

from __future__ import annotations

import base64
import json
import socketserver
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from service.domain.plain import plain
from tests import files, poison
from tests.patience import soon
from tests.service.asking import ok
from tests.service.desks import Desk

with tempfile.TemporaryDirectory() as _folder:
    DRAWINGS, SCANS = poison.drawings(Path(_folder)), poison.scans(Path(_folder))

TUS = {"Tus-Resumable": "1.0.0"}
FILES = ("walls.geojson", "removed.geojson")


def _judged(desk: Desk, purpose: str, name: str, content: bytes) -> dict[str, Any] | None:
    """Return the job that read a file, None where its upload was refused; what is served is plain JSON."""
    sent = desk.sent(purpose, name, content)
    if sent.status_code != 202:
        assert 400 <= sent.status_code < 500, sent.text
        desk.look.news()
        return None
    job = desk.ended(sent.json()["job"])
    if job["state"] == "failed":
        assert not job["problem"]["type"].endswith("/job-crashed"), job["problem"]
    elif purpose == "drawings":
        for part in FILES:
            told = json.loads(desk.client.get(f"/v1/drawings/{job['subject_id']}/{part}").text)
            assert plain(told) == told
    return job


@pytest.mark.parametrize("case", DRAWINGS)
def test_no_drawing_poisons_a_list(desk: Desk, case: str) -> None:
    _judged(desk, "drawings", *DRAWINGS[case])


@pytest.mark.parametrize("case", SCANS)
def test_no_scan_poisons_a_list(desk: Desk, case: str) -> None:
    _judged(desk, "scans", *SCANS[case])


def test_names_of_layers_are_told_plain(desk: Desk) -> None:
    job = _judged(desk, "drawings", *DRAWINGS["DXF, bytes that are no UTF-8"])
    assert job is not None
    told = ok(desk.client.get(f"/v1/drawings/{job['subject_id']}"))
    (hidden,) = [one for one in told["reading"]["findings"] if one["code"] == "layer-hidden"]
    assert hidden["values"]["layers"] == ["W" + 5 * "\N{REPLACEMENT CHARACTER}" + " HIDDEN"]


@pytest.mark.parametrize("name", [b"\xff\xfe\xed\xa0\x80.dxf", b"a\x1b[2J\x07.dxf", b"\xc2\x9b.dxf"])
def test_no_file_name_of_a_form_poisons_a_list(desk: Desk, name: bytes) -> None:
    head = b'--b\r\nContent-Disposition: form-data; name="file"; filename="%s"\r\n\r\n' % name
    answer = desk.client.post(
        f"/v1/maps/{desk.map_id}/drawings",
        content=head + files.png(90, 70, seed=len(name)) + b"\r\n--b--\r\n",
        headers={"Content-Type": "multipart/form-data; boundary=b"},
    )
    assert answer.status_code in {202, 422}, answer.text
    desk.look.news()


@pytest.mark.parametrize(
    "name", [b"\xff\xfe\xed\xa0\x80.png", b"a\x00b.png", b"\x1b[2J.png", b"\xc2\x9b.png"]
)
def test_no_metadata_of_an_upload_in_pieces_poisons_a_list(desk: Desk, name: bytes) -> None:
    content = files.png(80, 60, seed=len(name))
    told = {"map_id": desk.map_id.encode(), "kind": b"drawing", "filename": name, "note": name}
    metadata = ",".join(f"{key} {base64.b64encode(value).decode()}" for key, value in told.items())
    headers = TUS | {"Upload-Length": str(len(content)), "Upload-Metadata": metadata}
    begun = desk.client.post("/v1/tus", headers=headers)
    assert begun.status_code in {201, 400, 422}, begun.text
    if begun.status_code == 201:
        piece = TUS | {"Upload-Offset": "0", "Content-Type": "application/offset+octet-stream"}
        assert desk.client.head(begun.headers["location"], headers=TUS).status_code == 200
        assert desk.client.patch(begun.headers["location"], headers=piece, content=content).status_code == 204
    desk.look.news()


ANSWERS = {
    "a reason that is no text": b"HTTP/1.1 500 \xff\x1b[2J\x9b\r\nContent-Length: 0\r\n\r\n",
    "no HTTP": b"\xff\xfe\x00\x1b[2J\r\n\r\n",
    "a header that is none": b"HTTP/1.1 500 x\r\nA\x1b\xff: \xff\x00\r\n\r\n",
    "a move to nowhere": b"HTTP/1.1 302 Found\r\nLocation: http://\xff\x1b/\r\nContent-Length: 0\r\n\r\n",
    "a body that is no text": b"HTTP/1.1 500 x\r\nContent-Length: 9\r\n\r\n\xff\x00\x1b[2J\xed\xa0\x80",
}


@contextmanager
def _answering(answer: bytes) -> Iterator[str]:
    """Run a server that gives these very bytes to whoever asks; give its address."""

    class Handler(socketserver.BaseRequestHandler):
        def handle(self) -> None:
            self.request.recv(65536)
            self.request.sendall(answer)

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/hook"
        finally:
            server.shutdown()


@pytest.mark.parametrize("case", ANSWERS)
def test_no_answer_to_a_webhook_poisons_a_list(desk: Desk, case: str) -> None:
    with _answering(ANSWERS[case]) as url:
        hook = ok(desk.client.post("/v1/webhooks", json={"url": url, "events": ["job.failed"]}), 201)
        desk.told("drawings", "cut.dxf", b"  0\nSECTION\n  2\nENTITIES\n  0\nLINE\n" + case.encode())

        def tried() -> bool:
            found = ok(desk.client.get(f"/v1/webhooks/{hook['id']}/deliveries"))["items"]
            return bool(found and found[0]["tries"])

        soon(tried, "nothing was delivered")
        desk.look.news()
        assert desk.client.delete(f"/v1/webhooks/{hook['id']}").status_code == 204
