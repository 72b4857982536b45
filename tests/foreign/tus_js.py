"""The tus client of others that comes from npm, run by the Node of the virtual environment."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

_HERE = Path(__file__).resolve().parent
_CLIENTS = _HERE.parents[1] / "build" / "foreign-clients"
_NODE = Path(sys.executable).with_name("node")

TusJs = Callable[..., dict[str, Any]]


@pytest.fixture(scope="session")
def tus_js() -> TusJs:
    """Give a call that uploads a file and returns the story; skipped where the client was not fetched.

    It takes the service's address, the header with the sender's key, the file, a certificate to trust, and
    what `tus_upload.mjs` takes besides; `options` are tus-js-client's own.
    """
    if not (_CLIENTS / "node_modules" / "tus-js-client" / "package.json").is_file():
        pytest.skip("tus-js-client is not there: tools/setup --tests fetches it from npm")

    def upload(
        url: str, key: str, file: Path, *, trusting: Path | None = None, **order: Any
    ) -> dict[str, Any]:
        told = {
            "endpoint": f"{url}/v1/tus",
            "headers": {"Authorization": key},
            "file": str(file),
            **order,
        }
        run = subprocess.run(
            [str(_NODE), str(_HERE / "tus_upload.mjs"), str(_CLIENTS)],
            input=json.dumps(told),
            env=os.environ | ({} if trusting is None else {"NODE_EXTRA_CA_CERTS": str(trusting)}),
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        story: dict[str, Any] = json.loads(run.stdout)
        return story

    return upload
