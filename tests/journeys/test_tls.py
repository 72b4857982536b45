"""`groundplan up --tls`: HTTPS with a certificate of its own, made once."""

from __future__ import annotations

import re
import socket
import ssl
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from tests import web
from tests.patience import PATIENCE_S


@contextmanager
def up(data: Path, *more: str) -> Iterator[str]:
    """Run `groundplan up` and give its address."""
    log = data.parent / "up.log"
    with log.open("w", encoding="utf-8") as sink:
        process = subprocess.Popen(
            [sys.executable, "-m", "worker.cli", "up", "--data-dir", str(data), "--port", "0", *more],
            stdout=sink,
            stderr=subprocess.STDOUT,
        )
    try:
        yield _address(process, log)
    finally:
        process.terminate()
        assert process.wait(30) == 0


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        found = re.search(r"listens at (https?://\S+)", log.read_text(encoding="utf-8"))
        if found:
            return found.group(1)
        assert process.poll() is None, log.read_text(encoding="utf-8")
        time.sleep(0.05)
    raise AssertionError(log.read_text(encoding="utf-8"))


def test_https_with_a_certificate_that_is_made_once_and_can_be_trusted(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with up(data, "--tls") as address:
        assert address.startswith("https://")
        trusting = ssl.create_default_context(cafile=str(data / "tls" / "certificate.pem"))
        answer = web.get(f"{address}/readyz", verify=trusting)
        assert answer.status_code == 200
        by_name = web.get(address.replace("127.0.0.1", "localhost") + "/tablet", verify=trusting)
        assert by_name.status_code == 200
        with pytest.raises(httpx.ConnectError, match="certificate"):
            web.get(f"{address}/readyz")
    key = data / "tls" / "key.pem"
    assert stat.S_IMODE(key.stat().st_mode) == 0o600
    made = (key.read_bytes(), (data / "tls" / "certificate.pem").read_bytes())
    with up(data, "--tls") as address:
        assert web.get(f"{address}/healthz", verify=trusting).status_code == 200
    assert (key.read_bytes(), (data / "tls" / "certificate.pem").read_bytes()) == made


def test_the_certificate_names_the_address_that_tablets_in_the_plant_use(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            pytest.skip("this machine has no network, and so no address in it")
        address = probe.getsockname()[0]
    data = tmp_path / "data"
    with up(data, "--tls"):
        pass
    words = ["openssl", "x509", "-in", data / "tls" / "certificate.pem", "-noout", "-checkip", address]
    told = subprocess.run(words, capture_output=True, text=True, check=True)
    assert told.stdout.strip() == f"IP {address} does match certificate"


def test_a_certificate_without_its_key_is_refused(tmp_path: Path) -> None:
    words = [
        sys.executable,
        "-m",
        "worker.cli",
        "up",
        "--data-dir",
        str(tmp_path / "data"),
        "--tls-cert",
        "x.pem",
    ]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    assert done.returncode == 1
    assert "a certificate and its key belong together" in done.stderr
