"""`groundplan up`, `serve`, `worker`, `vda5050`, `migrate` and `key`: the processes of an installation."""

from __future__ import annotations

import argparse
import importlib.util
import os
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from worker.cli.certificate import CertificateNotMade, self_made
from worker.cli.supervision import Supervisor, start

_LOOK_EVERY_S = 0.2
_NEEDED_BY_VDA5050 = ("paho",)
_MODULES = {"worker": "worker", "vda5050": "worker.vda5050"}
_NEEDED = ("numba", "scipy", "cv2", "skimage", "PIL")


def add_arguments(name: str, parser: argparse.ArgumentParser) -> None:
    """Add the arguments of one of the commands; those of the service are its own to read."""
    if name in {"serve", "migrate", "key"}:
        parser.prefix_chars = "\0"  # whatever follows, --help included, goes to `python -m service`
        parser.add_argument("rest", nargs=argparse.REMAINDER)
        return
    parser.add_argument("--data-dir", type=Path, help="folder of files and, by default, of the database")
    if name == "up":
        parser.add_argument("--host", help="address on which the service listens")
        parser.add_argument("--port", type=int, help="port on which the service listens; 0 takes a free one")
        parser.add_argument("--tls", action="store_true", help="speak HTTPS, with a self-made certificate")
        parser.add_argument("--tls-cert", type=Path, metavar="PEM", help="speak HTTPS with this certificate")
        parser.add_argument("--tls-key", type=Path, metavar="PEM", help="private key of --tls-cert")


def run(name: str, args: argparse.Namespace) -> int:
    """Become the process that is asked for, or start both and stay with them."""
    if name in {"serve", "migrate", "key"}:
        os.execv(sys.executable, [sys.executable, "-m", "service", name, *args.rest])  # noqa: S606
    for option in ("data_dir", "host", "port", "tls_cert", "tls_key"):
        value = getattr(args, option, None)
        if value is not None:
            os.environ[f"GROUNDPLAN_{option.upper()}"] = str(value)
    needed, extra = (_NEEDED_BY_VDA5050, "vda5050") if name == "vda5050" else (_NEEDED, "worker")
    missing = [module for module in needed if importlib.util.find_spec(module) is None]
    if missing:
        print(
            f"groundplan {name}: this needs {', '.join(missing)}: install groundplan[{extra}]",
            file=sys.stderr,
        )
        return 1
    if name in _MODULES:
        os.execv(sys.executable, [sys.executable, "-m", _MODULES[name]])  # noqa: S606
    if args.tls and args.tls_cert is None:
        try:
            own = self_made(_data_dir(), host=args.host)
        except CertificateNotMade as error:
            print(f"groundplan up: {error}", file=sys.stderr)
            return 1
        os.environ |= {"GROUNDPLAN_TLS_CERT": str(own.certificate), "GROUNDPLAN_TLS_KEY": str(own.key)}
        print(f"Certificate, self-made: trust {own.certificate} on the tablets", flush=True)
    return _up()


def _data_dir() -> Path:
    return Path(os.environ.get("GROUNDPLAN_DATA_DIR", "groundplan-data"))


def _up() -> int:
    """Migrate, then keep service and worker running until told to stop (0) or until that is of no use (1)."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _signal, _frame: stop.set())
    migrated = start(["-m", "service", "migrate"]).wait()
    if migrated != 0:
        _tell("the database could not be brought to this version's schema")
        return 1
    if stop.is_set():
        return 0
    with _one_port():
        kept = Supervisor({"service": ["-m", "service", "serve"], "worker": ["-m", "worker"]}, tell=_tell)
        try:
            while not stop.wait(_LOOK_EVERY_S):
                if not kept.look():
                    return 1
        finally:
            kept.stop()
    return 0


@contextmanager
def _one_port() -> Iterator[None]:
    """Keep the address through new starts of the service: where it takes a free port, that is taken here.

    The port is bound here without listening, so that nobody else gets it while the service is away.
    """
    if os.environ.get("GROUNDPLAN_PORT") != "0":
        yield
        return
    host = os.environ.get("GROUNDPLAN_HOST", "127.0.0.1")
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as kept:
        kept.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            kept.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        try:
            kept.bind((host, 0))
            os.environ["GROUNDPLAN_PORT"] = str(kept.getsockname()[1])
        except OSError:
            pass  # the service itself says what is wrong with the host
        yield


def _tell(line: str) -> None:
    print(f"groundplan up: {line}", file=sys.stderr, flush=True)
