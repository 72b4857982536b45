"""The front of docker-compose.yml: the same nginx configuration, run here before a test's service."""

from __future__ import annotations

import os
import shutil
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from tests.patience import PATIENCE_S
from tests.server import ROOT, Server

CONFIGURATION = ROOT / "docker" / "front" / "nginx.conf"
PREFIX = {"GROUNDPLAN_FRONT_PREFIX": "/_blobs/"}


@dataclass(frozen=True)
class Front:
    """Hold where a front listens, the certificate that it shows, and its folder."""

    url: str
    certificate: Path
    folder: Path

    def client(self, key: str) -> httpx.Client:
        """Return a client that trusts the front's certificate."""
        trusted = ssl.create_default_context(cafile=str(self.certificate))
        headers = {"Authorization": f"Bearer {key}"}
        return httpx.Client(base_url=self.url, headers=headers, verify=trusted, timeout=PATIENCE_S)


def nginx_program() -> str:
    """Return nginx; the test is skipped where it is absent, but for CI, where it has to be there."""
    program = shutil.which("nginx", path=f"{os.environ['PATH']}:/usr/sbin")
    if program is None:
        assert not os.environ.get("CI"), "nginx is not installed: run tools/setup --tests"
        pytest.skip("nginx is not installed: run tools/setup --tests")
    return program


@contextmanager
def fronted(server: Server, folder: Path, *, is_up: bool = True) -> Iterator[Front]:
    """Run nginx with the configuration of the compose file before a service, which may have ended."""
    program = nginx_program()
    tls = folder / "tls"
    tls.mkdir(parents=True)
    certificate = make_certificate(tls)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    said = CONFIGURATION.read_text()
    for here, there in (
        ("server service:8000", f"server {urlsplit(server.url).netloc}"),
        ("listen 8443 ssl", f"listen 127.0.0.1:{port} ssl"),
        ("/etc/groundplan/tls/", f"{tls}/"),
        ("/var/lib/groundplan/blobs/", f"{server.settings.data_dir}/blobs/"),
    ):
        assert here in said
        said = said.replace(here, there)
    (folder / "nginx.conf").write_text(said)
    user = "user root; " if os.geteuid() == 0 else ""  # only root may read a test's folder
    command = [program, "-p", f"{folder}/", "-c", str(folder / "nginx.conf"), "-g", f"daemon off; {user}"]
    with (folder / "nginx.log").open("wb") as log:
        process = subprocess.Popen(command, stdout=log, stderr=log)
    front = Front(f"https://localhost:{port}", certificate, folder)
    try:
        _wait(front, process, status=200 if is_up else 502)
        yield front
    finally:
        process.terminate()
        process.wait()


def make_certificate(folder: Path) -> Path:
    """Return a certificate of `localhost`, made as `docker/front/start` makes one."""
    start = (ROOT / "docker" / "front" / "start").read_text()
    made = start[start.index("openssl req") : start.index("\nfi\n")]
    done = subprocess.run(["sh", "-euc", f"tls={folder}\n{made}"], capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder / "fullchain.pem"


def _wait(front: Front, process: subprocess.Popen[bytes], *, status: int) -> None:
    until = time.monotonic() + PATIENCE_S
    with front.client("none") as client:
        while True:
            try:
                assert client.get("/healthz").status_code == status
            except httpx.TransportError:
                assert process.poll() is None, (front.folder / "nginx.log").read_text()
                assert time.monotonic() < until
                time.sleep(0.05)
            else:
                return
