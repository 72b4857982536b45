"""The OpenAPI document as text; run as a module, it refreshes the snapshot beside it (`poe openapi`)."""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

from service.app import create_app, open_kernel
from service.settings import Settings
from tests.schemas import bring_to_head

SNAPSHOT = Path(__file__).with_name("openapi.json")


def described() -> str:
    """Return the document that the service gives at /openapi.json, indented."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data_dir=Path(folder))
        kernel = open_kernel(settings)
        try:
            bring_to_head(kernel.db)
            document = create_app(settings, kernel=kernel).openapi()
        finally:
            kernel.db.close()
    return json.dumps(document, indent=1, ensure_ascii=False, sort_keys=True) + "\n"


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    SNAPSHOT.write_text(described(), encoding="utf-8")
