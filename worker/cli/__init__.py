"""The `groundplan` command: one module a group of subcommands, loaded only when it is called for."""

from __future__ import annotations

import argparse
import importlib
import sys

from service.domain.errors import DomainError

_COMMANDS = {
    "up": ("worker.cli.processes", "start service and worker on SQLite and a local folder"),
    "serve": ("worker.cli.processes", "start the HTTP service"),
    "worker": ("worker.cli.processes", "start a worker"),
    "vda5050": ("worker.cli.processes", "bring maps to robots that speak VDA 5050 over MQTT"),
    "migrate": ("worker.cli.processes", "bring the database to this version's schema"),
    "key": ("worker.cli.processes", "create API keys"),
    "read": ("worker.cli.drawing", "find the walls of a drawing"),
    "build": ("worker.cli.drawing", "build a map from a drawing"),
    "align": ("worker.cli.registration", "place a scan on a map"),
    "merge": ("worker.cli.registration", "compound placed clouds into a map"),
}


def main(argv: list[str] | None = None) -> int:
    """Run one subcommand and return its exit status: 0 done, 1 refused (with one line why), 2 wrong usage.

    Each module in `_COMMANDS` has ``add_arguments(name, parser)`` and ``run(name, args) -> int``; it may
    import nothing heavy at its top, so that ``--help`` answers at once.
    """
    argv = sys.argv[1:] if argv is None else argv
    parser = argparse.ArgumentParser(prog="groundplan", description="Point-cloud maps from design drawings.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    named = argv[0] if argv and argv[0] in _COMMANDS else None
    for name, (module, help_) in _COMMANDS.items():
        sub = commands.add_parser(name, help=help_, description=help_[0].upper() + help_[1:] + ".")
        if name == named:
            importlib.import_module(module).add_arguments(name, sub)
    args = parser.parse_args(argv)
    try:
        status: int = importlib.import_module(_COMMANDS[args.command][0]).run(args.command, args)
    except DomainError as refusal:
        print(f"groundplan {args.command}: {refusal.slug()}: {refusal.detail}", file=sys.stderr)
        return 1
    return status
