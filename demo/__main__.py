"""`python -m demo`: play the whole story against a service started for it."""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from pathlib import Path

from demo.console import Console, DemoFailed


def main(argv: list[str] | None = None) -> int:
    """Play the story; return 0 if every step held and 1 if one did not."""
    args = _parser().parse_args(argv)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    console = Console()
    folder = args.output or Path(tempfile.mkdtemp(prefix="groundplan-demo-"))
    try:
        for seed in args.seed:
            place = folder if len(args.seed) == 1 else folder / f"seed-{seed}"
            place.mkdir(parents=True, exist_ok=True)
            _play(place.absolute(), seed, args, console)
    except DemoFailed as failure:
        sys.stderr.write(f"demo: {failure}\n")
        return 1
    except KeyboardInterrupt:
        console.say("stopped")
        return 0 if console.finished else 130
    return 0


def _play(folder: Path, seed: int, args: argparse.Namespace, console: Console) -> None:
    from demo.client import Client  # noqa: PLC0415  - the numerical packages are loaded after --help
    from demo.hall import synthetic_hall  # noqa: PLC0415
    from demo.running import groundplan_up  # noqa: PLC0415
    from demo.story import Story  # noqa: PLC0415

    console.act(f"Groundplan's demonstration, seed {seed}; its files: {folder}")
    with groundplan_up(folder, port=args.port) as running:
        console.say(f"service and worker run at {running.address}, on SQLite in {folder / 'data'}")
        story = Story(synthetic_hall(seed), Client(running.address, running.admin_key), folder, console)
        preview = story.play()
        console.finished = True
        console.act("All steps held: revision 2 is published, downloaded and verified")
        console.say(f"look at {preview}")
        if args.wait and seed == args.seed[-1]:
            console.say(f"{running.address} stays up; admin key: {running.admin_key}; Ctrl-C stops it")
            status = running.process.wait()
            raise DemoFailed(f"groundplan up ended by itself with status {status}")


def _seeds(text: str) -> list[int]:
    """Return the seeds that `7` or `1..20` names."""
    first, _, last = text.partition("..")
    return list(range(int(first), int(last or first) + 1))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="demo", description=__doc__)
    parser.add_argument(
        "--seed", type=_seeds, default="1", help="which hall is generated (default 1); several: 1..20"
    )
    parser.add_argument("--output", type=Path, help="a new folder for its files (default: a temporary one)")
    parser.add_argument("--port", type=int, default=0, help="port of the service (default: a free one)")
    parser.add_argument(
        "--wait",
        action=argparse.BooleanOptionalAction,
        default=sys.stdout.isatty(),
        help="stay up at the end until Ctrl-C (default: at a terminal)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
