"""The front's start script, run as a user to whom its volume may not belong."""

from __future__ import annotations

import os
import pwd
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT

pytestmark = pytest.mark.slow

START = ROOT / "docker" / "front" / "start"
IS_ROOT = os.geteuid() == 0
OTHER = pwd.getpwnam("nobody")
"""Who runs the script where the tests may choose: as the image's `nginx`, it has no rights of root."""


@pytest.fixture
def tls() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="groundplan-front-"))  # others cannot enter pytest's folders
    folder.chmod(0o755)
    volume = folder / "tls"
    volume.mkdir(mode=0o755)
    yield volume
    volume.chmod(0o755)
    shutil.rmtree(folder)


def _start(volume: Path) -> subprocess.CompletedProcess[str]:
    """Run the script up to the start of nginx, which is named instead."""
    said = START.read_text().replace("/etc/groundplan/tls", str(volume))
    said, replaced = re.subn(r"^exec (nginx) .*$", r"echo \1", said, flags=re.MULTILINE)
    assert replaced == 1
    user = {"user": OTHER.pw_uid, "group": OTHER.pw_gid, "extra_groups": []} if IS_ROOT else {}
    return subprocess.run(["sh", "-c", said], capture_output=True, text=True, check=False, cwd="/", **user)  # type: ignore[call-overload,no-any-return]


def _give(volume: Path) -> None:
    """Do what the refusal says: the volume, and what is in it, belongs to who runs the script."""
    for path in (volume, *volume.iterdir()):
        if IS_ROOT:
            os.chown(path, OTHER.pw_uid, OTHER.pw_gid)
        else:
            path.chmod(0o755 if path.is_dir() else 0o600)


def _refused(volume: Path, why: str) -> None:
    done = _start(volume)
    assert (done.returncode, done.stdout) == (1, "")
    assert why in done.stderr
    assert "docker run --rm -u 0 -v groundplan_tls:/t groundplan-front chown -R " in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize("name", ["privkey.pem", "fullchain.pem"])
def test_a_file_of_another_user_is_refused_in_words(tls: Path, name: str) -> None:
    for each in ("privkey.pem", "fullchain.pem"):
        (tls / each).write_text("of an older version")
        (tls / each).chmod(0o644)
    (tls / name).chmod(0o600 if IS_ROOT else 0)
    _refused(tls, f"{name} cannot be read")
    _give(tls)
    assert _start(tls).stdout == "nginx\n"


def test_a_folder_of_another_user_is_refused_in_words(tls: Path) -> None:
    tls.chmod(0o755 if IS_ROOT else 0o555)
    _refused(tls, "none can be made")
    _give(tls)
    assert _start(tls).stdout == "nginx\n"
    assert (tls / "privkey.pem").stat().st_mode & 0o077 == 0


def test_the_refusal_names_the_image_and_the_volume_of_the_compose_file() -> None:
    said = (ROOT / "docker-compose.yml").read_text()
    assert "image: groundplan-front\n" in said
    assert "- tls:/etc/groundplan/tls\n" in said
