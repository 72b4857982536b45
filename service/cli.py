"""The commands of the service's process: `serve`, `migrate` and `key create`."""

from __future__ import annotations

import argparse
import json
import resource
import signal
import socket
import sys
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn
from fastapi import FastAPI
from pydantic import ValidationError

from service import crash_points, logs
from service.app import (
    BlobsMissing,
    create_app,
    open_kernel,
    require_blobs,
)
from service.db.schema import ReferencesBroken, SchemaNotCurrent, require_schema, upgrade, version
from service.db.session import SQLAlchemyError
from service.domain.errors import DomainError
from service.domain.lifecycle import Role
from service.protocol import Http, headers_of_all_answers
from service.settings import Settings
from service.usecases.keys import NewKey, create_first_key, create_key_at_the_console

_GRACE_S = 10
"""Seconds that a stopping service gives to answers under way."""


class _Server(uvicorn.Server):
    """A server that says where it listens, and tells open event streams to end when it is to stop."""

    def __init__(self, config: uvicorn.Config, *, app: FastAPI, address: str) -> None:
        super().__init__(config)
        self._app = app
        self._address = address

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            _say(f"Groundplan listens at {self._address}")

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:  # noqa: ARG002 - the interface
        """Stop gracefully; a second SIGINT at once. The signal is not raised again: stopping is success."""
        self._app.state.broadcast.stop()
        self.force_exit = self.should_exit and sig == signal.SIGINT
        self.should_exit = True


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit status: 0 done, 1 refused (with one line why), 2 wrong usage."""
    args = _parser().parse_args(argv)
    try:
        settings = Settings(
            **{name: value for name, value in vars(args.settings).items() if value is not None}
        )
    except ValidationError as error:
        first = error.errors()[0]
        return _refuse(args, f"the setting {'.'.join(map(str, first['loc']))}: {first['msg']}")
    try:
        logs.configure(level=settings.log_level)
        crash_points.arm_from(settings.crash_at, folder=settings.data_dir)
        status: int = args.run(settings, args)
    except DomainError as refusal:
        return _refuse(args, f"{refusal.slug()}: {refusal.detail}")
    except (SchemaNotCurrent, BlobsMissing, ReferencesBroken, OSError, ValueError) as error:
        return _refuse(args, str(error))
    except SQLAlchemyError as error:
        return _refuse(
            args, f"the database {settings.shown_url()} cannot be used: {str(error).splitlines()[0]}"
        )
    return status


def _take_descriptors() -> None:
    """Raise the number of open files to what the system lets this process have: each stream holds one."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))


def _serve(settings: Settings, _args: argparse.Namespace) -> int:
    _take_descriptors()
    kernel = open_kernel(settings)
    try:
        require_blobs(kernel)
        app = create_app(settings, kernel=kernel)
        if settings.metrics_port is not None:
            app.state.metrics.serve(settings.metrics_host, settings.metrics_port)
        first = create_first_key(kernel)
        if first is not None:
            _say(f"First admin key, shown this once: {first.secret}")
        family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
        with socket.create_server((settings.host, settings.port), family=family, backlog=2048) as listening:
            # inherited by each connection: head and body of an answer are two writes, and by Nagle's rule
            # the second would wait for the client's delayed acknowledgement of the first, 40 ms
            listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            config = uvicorn.Config(
                app,
                log_config=None,
                access_log=False,
                server_header=False,
                proxy_headers=bool(settings.fronts()),
                forwarded_allow_ips=settings.fronts(),
                http=Http,
                headers=headers_of_all_answers(
                    hsts_s=settings.hsts_s if settings.is_reached_by_https() else 0
                ),
                timeout_graceful_shutdown=_GRACE_S,
                ssl_certfile=settings.tls_cert,
                ssl_keyfile=settings.tls_key,
            )
            scheme = "http" if settings.tls_cert is None else "https"
            address = f"{scheme}://{_place(settings.host, listening.getsockname()[1])}"
            _Server(config, app=app, address=address).run(sockets=[listening])
    finally:
        kernel.db.close()
    return 0


def _migrate(settings: Settings, args: argparse.Namespace) -> int:
    kernel = open_kernel(settings)
    try:
        require_blobs(kernel)
        before = version(kernel.db.engine)
        upgrade(kernel.db.engine)
        if args.json:
            _say(json.dumps({"schema_before": before, "schema": version(kernel.db.engine)}))
    finally:
        kernel.db.close()
    return 0


def _create_key(settings: Settings, args: argparse.Namespace) -> int:
    kernel = open_kernel(settings)
    try:
        require_schema(kernel.db.engine)
        made = create_key_at_the_console(kernel, name=args.name, role=Role(args.role), map_ids=args.map)
        _say(json.dumps(_told(made)) if args.json else made.secret)
    finally:
        kernel.db.close()
    return 0


def _told(made: NewKey) -> dict[str, Any]:
    """Return a new key as `POST /v1/keys` answers; it is neither revoked nor ever expires."""
    return {
        "id": made.key.id,
        "name": made.key.name,
        "role": made.key.role,
        "map_ids": made.key.map_ids,
        "created_at": made.key.created_at.isoformat(),
        "expires_at": None,
        "revoked_at": None,
        "key": made.secret,
    }


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m service", description="The Groundplan HTTP service.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    serve = commands.add_parser("serve", help="answer HTTP requests until SIGTERM or SIGINT")
    serve.add_argument("--host", action=_Setting, help="address to listen on")
    serve.add_argument("--port", action=_Setting, type=int, help="port to listen on; 0 takes a free one")
    serve.set_defaults(run=_serve)
    migrate = commands.add_parser("migrate", help="bring the database to this version's schema")
    migrate.set_defaults(run=_migrate)
    key = commands.add_parser("key", help="API keys").add_subparsers(
        dest="verb", required=True, metavar="VERB"
    )
    create = key.add_parser("create", help="make an API key and print it, once")
    create.add_argument("--role", required=True, choices=[role.value for role in Role])
    create.add_argument("--name", default="made at the console", help="what people call the key")
    create.add_argument("--map", action="append", metavar="ID", help="limit the key to this map; repeatable")
    create.set_defaults(run=_create_key)
    for command in (migrate, create):
        command.add_argument("--json", action="store_true", help="print the result as JSON on stdout")
    for command in (serve, migrate, create):
        command.add_argument("--data-dir", action=_Setting, type=Path, help="folder of files and database")
        command.set_defaults(settings=argparse.Namespace())
    return parser


class _Setting(argparse.Action):
    """Put an option among the settings, where it outweighs the environment."""

    def __call__(self, _parser: Any, namespace: Any, values: Any, _option: str | None = None) -> None:
        setattr(namespace.settings, self.dest, values)


def _place(host: str, port: int) -> str:
    reachable = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(host)  # noqa: S104 - what an operator may set
    return f"{reachable or (f'[{host}]' if ':' in host else host)}:{port}"


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def _refuse(args: argparse.Namespace, why: str) -> int:
    sys.stderr.write(f"groundplan {args.command}: {why}\n")
    return 1
