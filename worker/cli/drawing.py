"""`groundplan read` and `groundplan build`: a drawing to its walls, and to a map."""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.domain.drawing_options import DrawingOptions
from service.domain.errors import InvalidRequest, NotFound, ScaleUnknown
from service.domain.formats import Purpose, listed
from service.domain.recipe import MapFromDrawing, Recipe
from service.domain.scale_hint import KnownLength, ScaleHint

if TYPE_CHECKING:
    from worker.geometry.drawing.reading.reading import Reading

_MOST_EDITS_BYTES = 16 << 20


def add_arguments(name: str, parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``read`` or ``build``."""
    parser.add_argument(
        "drawing", type=Path, metavar="DRAWING", help=listed(Purpose.DRAWING, with_others=True)
    )
    scale = parser.add_argument_group("scale (one of these; else what the drawing itself shows)")
    scale.add_argument("--scale", metavar="1:N", help="scale of the sheet; needs --dpi")
    scale.add_argument("--dpi", type=float, help="pixels an inch of the sheet; else what the file states")
    scale.add_argument("--metres-per-unit", type=float, metavar="X", help="metres per pixel or drawing unit")
    scale.add_argument(
        "--known-length",
        action="append",
        metavar="x1,y1,x2,y2,L",
        help="two pixels (y down) or points in drawing units, and metres; may be repeated",
    )
    part = parser.add_argument_group("what is read")
    part.add_argument("--page", type=int, metavar="N", help="page of a PDF or TIFF, counted from 1")
    part.add_argument("--storey", metavar="NAME", help="storey of a building model")
    part.add_argument("--cut-height", type=float, metavar="M", help="where a storey is cut, above its floor")
    part.add_argument(
        "--wall-layer", action="append", metavar="NAME", help="layer that holds walls; may be repeated"
    )
    part.add_argument("--edits", type=Path, metavar="FILE", help="corrections: a JSON list, or a reading's")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="made or refreshed")
    parser.add_argument("--json", action="store_true", help="print the result as JSON on stdout")
    if name == "build":
        parser.add_argument("--voxel-size", type=float, default=0.4, metavar="M")
        parser.add_argument("--wall-height", type=float, default=2.5, metavar="M")
        parser.add_argument("--floor", action="store_true", help="add a plane at z = 0")
        parser.add_argument("--ceiling", action="store_true", help="add a plane at the wall height")
        parser.add_argument("--map-from-drawing", metavar="x,y,yaw_deg", help="T_map_drawing")


def run(name: str, args: argparse.Namespace) -> int:
    """Read a drawing, and for ``build`` make its map; return 0.

    Everything is written beside the output folder first and moved into it when it is complete.
    """
    recipe = _recipe(args) if name == "build" else None
    if not args.drawing.is_file():
        raise NotFound(f"There is no file {args.drawing}.")
    options = _options(args)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    if args.output.exists() and not args.output.is_dir():
        raise InvalidRequest(f"{args.output} is a file; -o takes a folder.")
    work = Path(tempfile.mkdtemp(prefix=f".{args.output.name}.", dir=args.output.parent))
    try:
        reading, result = _read(args, options, work)
        if recipe is not None:
            if reading.unit != "m":
                raise ScaleUnknown(
                    "A map needs the drawing's scale, and no two witnesses of it agree: give --known-length, "
                    "--metres-per-unit, or --scale with --dpi."
                )
            result = _build(args, options, reading, recipe, work)
        _publish(work, args.output)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    _say(args, result)
    return 0


def _read(args: argparse.Namespace, options: DrawingOptions, work: Path) -> tuple[Reading, dict[str, Any]]:
    from worker.formats.drawing import read_drawing_file  # noqa: PLC0415 - heavy: --help answers at once
    from worker.formats.reading import write_reading  # noqa: PLC0415

    reading = read_drawing_file(args.drawing, options=options, progress=_progress)
    if args.command == "read":
        write_reading(reading, work)
        return reading, json.loads((work / "reading.json").read_text(encoding="utf-8"))
    return reading, {}


def _build(
    args: argparse.Namespace, options: DrawingOptions, reading: Reading, recipe: Recipe, work: Path
) -> dict[str, Any]:
    from service.domain.drawing_frame import DrawingFrame  # noqa: PLC0415 - as above
    from service.domain.report import BuildInputs, DrawingInput  # noqa: PLC0415
    from worker.formats.artifacts import write_artifacts  # noqa: PLC0415

    with args.drawing.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    x, y = (round(v, 4) for v in reading.origin)
    top = None if reading.top is None else round(reading.top, 4)
    named = DrawingInput(digest, name=args.drawing.name, options=options)
    write_artifacts(
        work,
        walls=reading.walls,
        columns=reading.columns,
        recipe=recipe,
        inputs=BuildInputs(named, reading.scale.told()),
        drawing=DrawingFrame((x, y), top),
        findings=reading.findings,
        progress=_progress,
    )
    report: dict[str, Any] = json.loads((work / "report.json").read_text(encoding="utf-8"))
    return report


def _publish(work: Path, output: Path) -> None:
    """Move the finished files into place: the folder at once where it is new, else file by file."""
    work.chmod(0o755)
    if not output.exists():
        work.rename(output)
        return
    for path in sorted(work.iterdir()):
        path.replace(output / path.name)


def _say(args: argparse.Namespace, result: dict[str, Any]) -> None:
    print(file=sys.stderr)
    for finding in result.get("findings", ()):
        if finding["severity"] != "info":
            print(f"{finding['severity']}: {finding['code']}: {finding['message']}", file=sys.stderr)
    if args.json:
        print(json.dumps({"output": str(args.output), **result}, sort_keys=True))
        return
    counts = result["counts"]
    points = f", {counts['points']} points" if "points" in counts else ""
    print(f"{args.output}: {counts['walls']} walls{points}")


def _progress(stage: str, share: float) -> None:
    print(f"\r{share:4.0%} {stage:<24}", end="", file=sys.stderr, flush=True)


def _options(args: argparse.Namespace) -> DrawingOptions:
    """Return what the arguments say of the drawing, checked as an upload's fields are."""
    said: dict[str, Any] = {
        "page": args.page,
        "storey": args.storey,
        "cut_height_m": args.cut_height,
        "wall_layers": args.wall_layer,
        "edits": None if args.edits is None else _edits(args.edits),
    }
    hint = _scale(args)
    return replace(DrawingOptions().changed(said), scale=hint)


def _edits(path: Path) -> object:
    """Return the list of edits in a JSON file: the list alone, or an object that holds it as ``edits``."""
    if not path.is_file():
        raise NotFound(f"There is no file {path}.")
    if path.stat().st_size > _MOST_EDITS_BYTES:
        raise InvalidRequest(f"{path} is larger than {_MOST_EDITS_BYTES >> 20} MiB; edits are fewer.")
    try:
        value = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise InvalidRequest(f"{path} is no JSON: {error}.") from error
    return value.get("edits") if isinstance(value, dict) else value


def _scale(args: argparse.Namespace) -> ScaleHint | None:
    ratio, dpi = None, args.dpi
    if args.scale is not None:
        ratio = _ratio(args.scale)
        if dpi is None:
            from worker.formats.raster import load_dpi  # noqa: PLC0415

            dpi = load_dpi(args.drawing)
    lengths = tuple(KnownLength(*_numbers(k, 5, "--known-length")) for k in args.known_length or ())
    if ratio is None and not lengths and args.metres_per_unit is None:
        return None
    hint = ScaleHint(
        metres_per_unit=args.metres_per_unit,
        ratio=ratio,
        dpi=dpi if ratio else None,
        known_length=lengths[0] if len(lengths) == 1 else None,
        known_lengths=lengths if len(lengths) > 1 else (),
    )
    hint.metres_per_px()
    return hint


def _ratio(text: str) -> float:
    try:
        drawn, real = (float(v) for v in text.split(":"))
        ratio = real / drawn
    except (ValueError, ZeroDivisionError) as error:
        raise InvalidRequest(f"--scale is 1:N, such as 1:100, not {text!r}.") from error
    return ratio


def _numbers(text: str, count: int, option: str) -> list[float]:
    try:
        values = [float(v) for v in text.split(",")]
    except ValueError as error:
        raise InvalidRequest(f"{option} takes {count} numbers with commas, not {text!r}.") from error
    if len(values) != count or not all(math.isfinite(v) for v in values):
        raise InvalidRequest(f"{option} takes {count} finite numbers with commas, not {text!r}.")
    return values


def _recipe(args: argparse.Namespace) -> Recipe:
    pose = MapFromDrawing()
    if args.map_from_drawing is not None:
        x, y, yaw_deg = _numbers(args.map_from_drawing, 3, "--map-from-drawing")
        pose = MapFromDrawing(x, y, math.radians(yaw_deg))
    return Recipe(
        voxel_size_m=args.voxel_size,
        wall_height_m=args.wall_height,
        floor=args.floor,
        ceiling=args.ceiling,
        map_from_drawing=pose,
    )
