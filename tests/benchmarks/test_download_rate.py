"""How fast a large artifact comes: the bare service beside nginx, and the front beside nginx with TLS."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import socket
import statistics
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from service.settings import Settings
from tests.front import PREFIX, fronted, make_certificate, nginx_program
from tests.server import running, start
from tests.service.asking import a_map, ok
from tests.service.by_hand import ByHand

pytestmark = pytest.mark.benchmark

SIZE_BYTES = 100 * 1000 * 1000
ROUNDS, SECONDS = 5, 4
LEAST_OF_NGINX, LEAST_OF_NGINX_BEHIND_THE_FRONT = 0.25, 0.9


@contextmanager
def plain_nginx(folder: Path, blob: Path) -> Iterator[tuple[str, str]]:
    """Run nginx that sends one file as it is, and give its addresses without and with TLS."""
    certificate = make_certificate(folder)
    ports = []
    for _ in range(2):
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            ports.append(probe.getsockname()[1])
    (folder / "nginx.conf").write_text(
        f"worker_processes auto;\npid nginx.pid;\nerror_log stderr warn;\nevents {{}}\nhttp {{\n"
        "access_log off; sendfile on; sendfile_max_chunk 2m; tcp_nopush on;\n"
        "client_body_temp_path a; proxy_temp_path b; fastcgi_temp_path c; uwsgi_temp_path d;\n"
        f"scgi_temp_path e;\nserver {{ listen 127.0.0.1:{ports[0]}; listen 127.0.0.1:{ports[1]} ssl;\n"
        f"ssl_certificate {certificate}; ssl_certificate_key {folder}/privkey.pem;\n"
        f"ssl_protocols TLSv1.2 TLSv1.3; root {blob.parent};\n}}\n}}\n"
    )
    user = "user root; " if os.geteuid() == 0 else ""
    process = subprocess.Popen(
        [nginx_program(), "-p", f"{folder}/", "-c", str(folder / "nginx.conf"), "-g", f"daemon off; {user}"]
    )
    try:
        time.sleep(1.0)
        assert process.poll() is None
        yield f"http://127.0.0.1:{ports[0]}/{blob.name}", f"https://localhost:{ports[1]}/{blob.name}"
    finally:
        process.terminate()
        process.wait()


def rate(url: str, key: str) -> float:
    """Return the bytes a second that wrk gets by four connections, as robots come at the same time."""
    command = ["wrk", "-t1", "-c4", f"-d{SECONDS}s", "-H", f"Authorization: Bearer {key}", url]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "Non-2xx" not in told, told
    read = re.search(r"Transfer/sec:\s+([\d.]+)([KMG]?)B", told)
    assert read is not None, told
    return float(read[1]) * {"": 1, "K": 2**10, "M": 2**20, "G": 2**30}[read[2]]


def test_downloads_beside_nginx(tmp_path: Path) -> None:
    if shutil.which("wrk") is None:
        pytest.skip("wrk is not installed: apt-get install wrk")
    with running(Settings(data_dir=tmp_path / "data")) as bare:
        admin, by_hand = bare.client(bare.admin_key), ByHand(bare.kernel)
        map_id = a_map(admin)
        asked = ok(
            admin.post(f"/v1/maps/{map_id}/revisions", json={"drawing_id": by_hand.drawing(map_id)}), 202
        )
        by_hand.build(asked["job"]["id"], cloud=secrets.token_bytes(SIZE_BYTES))
        path = f"/v1/maps/{map_id}/revisions/1/artifacts/point-cloud.pcd"
        sha256 = admin.head(path).headers["etag"].strip('"')
        behind = start(bare.settings, admin_key=bare.admin_key, **PREFIX)
        (tmp_path / "plain").mkdir()
        blob = bare.kernel.blobs.path(sha256)
        try:
            with (
                fronted(behind, tmp_path / "front") as front,
                plain_nginx(tmp_path / "plain", blob) as (plain, tls),
            ):
                ways = {"nginx": plain, "service": bare.url + path, "tls": tls, "front": front.url + path}
                rates: dict[str, list[float]] = {name: [] for name in ways}
                for _ in range(ROUNDS):
                    for name, url in ways.items():
                        rates[name].append(rate(url, bare.admin_key))
        finally:
            behind.close()
    median = {name: statistics.median(found) for name, found in rates.items()}
    shown = {name: round(found / 1e6) for name, found in median.items()}
    print(f"\n100 MB by wrk -c4, {ROUNDS} rounds, medians [MB/s]: {shown}")
    of_nginx, of_tls = median["service"] / median["nginx"], median["front"] / median["tls"]
    print(f"bare service / nginx = {of_nginx:.2f}; front / nginx with TLS = {of_tls:.2f}")
    assert of_nginx >= LEAST_OF_NGINX
    assert of_tls >= LEAST_OF_NGINX_BEHIND_THE_FRONT
