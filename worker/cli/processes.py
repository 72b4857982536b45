"""`groundplan up`, `serve`, `worker`, `vda5050`, `migrate` and `key`: the processes of an installation."""

from __future__ import annotations

import argparse
import ctypes
import importlib.util
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

from worker.cli.certificate import CertificateNotMade, self_made

_STOP_S = 20.0
_LOOK_EVERY_S = 0.2
_PR_SET_PDEATHSIG = 1
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
    """Migrate, start service and worker, and stay until told to stop (0) or until one of them ends (1)."""
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _signal, _frame: stop.set())
    migrated = _start("service", "migrate").wait()
    if migrated != 0:
        print("groundplan up: the database could not be brought to this version's schema", file=sys.stderr)
        return 1
    if stop.is_set():
        return 0
    running = {"service": _start("service", "serve"), "worker": _start("worker")}
    try:
        while not stop.wait(_LOOK_EVERY_S):
            ended = {name: p.poll() for name, p in running.items() if p.poll() is not None}
            for name, status in ended.items():
                print(f"groundplan up: the {name} ended by itself ({_how(status)})", file=sys.stderr)
            if ended:
                return 1
    finally:
        _stop(list(running.values()))
    return 0


def _start(*words: str) -> subprocess.Popen[bytes]:
    """Start ``python -m WORDS`` in a session of its own, so that Ctrl-C reaches it through this one."""
    return subprocess.Popen(
        [sys.executable, "-m", *words],
        start_new_session=True,
        preexec_fn=_end_with_parent,  # noqa: PLW1509 - no thread runs here
    )


def _end_with_parent() -> None:
    """Let the kernel end the new process when this one is killed."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)


def _stop(processes: list[subprocess.Popen[bytes]]) -> None:
    for process in processes:
        if process.poll() is None:
            process.terminate()
    for process in processes:
        try:
            process.wait(_STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _how(status: int | None) -> str:
    if status is not None and status < 0:
        return f"killed by {signal.Signals(-status).name}"
    return f"status {status}"
