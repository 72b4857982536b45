"""A process of its own that turns a DWG file into DXF: native code that a bad file may take down with it.

Run by path with ``python -I``: source, target, bytes of memory, seconds of CPU, bytes of input. It ends with
0, or with one of the statuses below and a line on stderr.
"""

from __future__ import annotations

import argparse
import resource
import sys
from pathlib import Path

MALFORMED, TOO_COMPLEX, UNSUPPORTED = 3, 4, 5

_EXPANSION = 8
_MOST_OBJECTS = 5_000_000
_DEEPEST = 64


def main(source: str, target: str, memory: int, seconds: int, size: int) -> int:
    """Return the status after converting `source` to `target` within limits."""
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import cadkit  # noqa: PLC0415  # under the limits already

    try:
        document = cadkit.read(
            source,
            max_input_bytes=size,
            max_decompressed_bytes=size * _EXPANSION,
            max_objects=_MOST_OBJECTS,
            max_depth=_DEEPEST,
        )
        Path(target).write_bytes(document.to_dxf_bytes())
    except (cadkit.LimitExceededError, MemoryError) as error:
        return _failed(TOO_COMPLEX, error)
    except cadkit.UnsupportedError as error:
        return _failed(UNSUPPORTED, error)
    except cadkit.CadkitError as error:
        return _failed(MALFORMED, error)
    return 0


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="The worker starts this for one DWG file.")
    parser.add_argument("source", help="the DWG file")
    parser.add_argument("target", help="the DXF file that is written")
    parser.add_argument("memory", type=int, help="the most bytes of memory")
    parser.add_argument("seconds", type=int, help="the most seconds of CPU")
    parser.add_argument("size", type=int, help="the most bytes of input")
    return parser.parse_args()


def _failed(status: int, error: Exception) -> int:
    sys.stderr.write(str(error)[:300])
    return status


if __name__ == "__main__":
    sys.exit(main(**vars(_asked())))
