"""The service's process: `python -m service serve | migrate | key create`."""

from __future__ import annotations

import gc
import sys


def main() -> int:
    """Run one command and return its exit status, as `service.cli.main` does.

    Notes
    -----
    What imports make stays for good. Looking for garbage among it takes a sixth of the time to the first
    answer, and again each time all is looked through later; so it is set aside before the collector begins.
    """
    gc.disable()
    from service import cli  # noqa: PLC0415 - after the line above

    gc.freeze()
    gc.enable()
    return cli.main()


if __name__ == "__main__":
    sys.exit(main())
