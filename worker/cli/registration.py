"""`groundplan align` and `groundplan merge`: a scan to its place on a map, and into the map."""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from service.domain.errors import InvalidRequest, NotFound
from service.domain.formats import Purpose, listed
from service.domain.scan_options import ScanOptions

if TYPE_CHECKING:
    from service.domain.transform import Transform


def add_arguments(name: str, parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``align`` or ``merge``."""
    if name == "align":
        parser.add_argument("scan", type=Path, metavar="SCAN", help=listed(Purpose.SCAN))
        parser.add_argument(
            "--scan-up", metavar="AXIS", help="its up axis: x, y, z, or --scan-up=-y; else it is found"
        )
        parser.add_argument("--scan-unit", metavar="UNIT", help="m, cm, mm, ft or in; else it is found")
        parser.add_argument(
            "--map", type=Path, required=True, help="a PCD, or the folder that `groundplan build` wrote"
        )
        where = parser.add_mutually_exclusive_group()
        where.add_argument(
            "--guess",
            metavar="x,y,z,yaw_deg",
            help="rough T_map_scan (of the scan upright), within 3 m and 45 deg",
        )
        where.add_argument("--search", action="store_true", help="search the whole map (the default)")
        parser.add_argument("--ndt-resolution", type=float, default=1.0, metavar="M", help="edge of a cell")
        parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR")
    else:
        parser.add_argument("map", type=Path, metavar="MAP.pcd")
        parser.add_argument("placed", type=Path, nargs="+", metavar="PLACED.pcd", help="in frame map")
        parser.add_argument(
            "--voxel-size", type=float, required=True, metavar="M", help="for the map's points"
        )
        parser.add_argument(
            "--layer-voxel-size", type=float, default=0.05, metavar="M", help="for the placed points"
        )
        parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.pcd")
    parser.add_argument("--json", action="store_true", help="print the result as JSON on stdout")


def run(name: str, args: argparse.Namespace) -> int:
    """Place a scan, or compound placed clouds into a map; return 0.

    A placement that is rejected is a result as well: the verdict says so, the status is 0.
    """
    result = _align(args) if name == "align" else _merge(args)
    print(file=sys.stderr)
    if args.json:
        json.dump(result, sys.stdout, indent=2)
        print()
    elif name == "align":
        _tell(result)
    else:
        print(f"{args.output}: {result['points']} points, {result['points_of_layers']} of them of layers")
    return 0


def _align(args: argparse.Namespace) -> dict[str, Any]:
    """Place a scan and write placement.json, aligned.pcd, target.pcd and labels.npy together."""
    initial = _guess(args)
    if not (math.isfinite(args.ndt_resolution) and 0.05 <= args.ndt_resolution <= 20.0):
        raise InvalidRequest(
            f"--ndt-resolution is {args.ndt_resolution}; it has to lie between 0.05 and 20 m."
        )
    options = ScanOptions.of(args.scan_up, args.scan_unit)
    if not args.scan.is_file():
        raise NotFound(f"There is no scan {args.scan}.")
    from service.domain.acceptance import judge  # noqa: PLC0415 - heavy from here on: --help answers at once
    from worker.formats.built_map import load_target  # noqa: PLC0415
    from worker.formats.scan import read_upright_scan  # noqa: PLC0415
    from worker.geometry.registration.place_upright import place_upright_scan  # noqa: PLC0415

    _progress("load", 0.0)
    upright, target = read_upright_scan(args.scan, options=options), load_target(args.map)
    placed = place_upright_scan(
        upright, target, initial=initial, ndt_resolution=args.ndt_resolution, progress=_progress
    )
    result = {
        "T_map_scan": placed.T_map_scan.tolist(),
        **judge(placed.evidence).to_json(),
        "evidence": placed.evidence.to_json(),
        "candidates": [candidate.to_json() for candidate in placed.candidates],
        "scan_frame": upright.frame.told().to_json(),
        "findings": [finding.to_json() for finding in upright.findings()],
    }
    _write(args.output, result, upright.scan, placed)
    return result


def _write(output: Path, result: dict[str, Any], scan: Any, placed: Any) -> None:
    """Write the files of a placement beside the folder, and move them in when all are complete."""
    import numpy as np  # noqa: PLC0415 - heavy: --help answers at once

    from service.domain.layer_part import TARGET  # noqa: PLC0415
    from worker.formats.pcd import write_pcd  # noqa: PLC0415
    from worker.geometry.cloud.point_cloud import Label, PointCloud  # noqa: PLC0415

    if output.exists() and not output.is_dir():
        raise InvalidRequest(f"{output} is a file; -o takes a folder.")
    output.parent.mkdir(parents=True, exist_ok=True)
    work = Path(tempfile.mkdtemp(prefix=f".{output.name}.", dir=output.parent))
    try:
        aligned = PointCloud.of(placed.T_map_scan.apply(scan.points), Label.LAYER)
        write_pcd(work / "aligned.pcd", aligned)
        target = placed.labels == TARGET
        write_pcd(work / "target.pcd", PointCloud(aligned.points[target], aligned.labels[target]))
        np.save(work / "labels.npy", placed.labels)
        text = json.dumps(result, indent=2, allow_nan=False)
        (work / "placement.json").write_text(text + "\n", encoding="utf-8")
        output.mkdir(exist_ok=True)
        for name in ("aligned.pcd", "target.pcd", "labels.npy", "placement.json"):
            (work / name).replace(output / name)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _merge(args: argparse.Namespace) -> dict[str, Any]:
    """Compound placed clouds into a map's cloud and write it whole; what is filtered stays as it is."""
    for option in ("voxel_size", "layer_voxel_size"):
        if not (math.isfinite(getattr(args, option)) and 0.005 <= getattr(args, option) <= 5.0):
            raise InvalidRequest(f"--{option.replace('_', '-')} has to lie between 0.005 and 5 m.")
    for path in (args.map, *args.placed):
        if not path.is_file():
            raise NotFound(f"There is no file {path}.")
    import numpy as np  # noqa: PLC0415 - heavy from here on: --help answers at once

    from worker.formats.pcd import read_pcd, write_pcd  # noqa: PLC0415
    from worker.formats.scan import read_map_points  # noqa: PLC0415
    from worker.geometry.cloud.point_cloud import Label, PointCloud  # noqa: PLC0415
    from worker.geometry.cloud.voxel_grid import filter_cloud, voxel_index  # noqa: PLC0415

    _progress("load", 0.0)
    base = read_pcd(args.map)
    parts = []
    for label in np.unique(base.labels):
        piece = PointCloud(base.points[base.labels == label], base.labels[base.labels == label])
        size = args.layer_voxel_size if label == Label.LAYER else args.voxel_size
        one_a_voxel = len(np.unique(voxel_index(piece.points, size), axis=0)) == len(piece)
        parts.append(piece if one_a_voxel else filter_cloud(piece, size, label=int(label)))
    layers = [filter_cloud(read_map_points(p), args.layer_voxel_size, label=Label.LAYER) for p in args.placed]
    _progress("merge", 0.5)
    every = [*parts, *layers]
    merged = PointCloud(np.vstack([c.points for c in every]), np.concatenate([c.labels for c in every]))
    args.output.parent.mkdir(parents=True, exist_ok=True)
    partial = args.output.with_name(f".{args.output.name}.{os.getpid()}")
    try:
        write_pcd(partial, merged)
        partial.replace(args.output)
    finally:
        partial.unlink(missing_ok=True)
    _progress("done", 1.0)
    return {"points": len(merged), "points_of_layers": int(np.count_nonzero(merged.labels == Label.LAYER))}


def _guess(args: argparse.Namespace) -> Transform | None:
    """Return the rough pose of ``--guess``, or None to search the whole map."""
    if args.guess is None:
        return None
    try:
        x, y, z, yaw_deg = (float(word) for word in args.guess.split(","))
    except ValueError:
        raise InvalidRequest(f"--guess is {args.guess!r}; it takes four numbers: x,y,z,yaw_deg.") from None
    if not all(math.isfinite(v) and abs(v) < 1e6 for v in (x, y, z, yaw_deg)):
        raise InvalidRequest("--guess takes four finite numbers below a million.")
    from service.domain.transform import Transform  # noqa: PLC0415 - numpy: --help answers at once

    return Transform.from_xyz_yaw(x, y, z, math.radians(yaw_deg))


def _tell(result: dict[str, Any]) -> None:
    """Print a placement for a person."""
    x, y, z = (row[3] for row in result["T_map_scan"][:3])
    yaw = math.degrees(math.atan2(result["T_map_scan"][1][0], result["T_map_scan"][0][0]))
    print(f"{result['verdict']}: x {x:.3f} m, y {y:.3f} m, z {z:.3f} m, yaw {yaw:.2f} degrees")
    for reason in result["reasons"]:
        print(f"  {reason['detail']}")


def _progress(stage: str, share: float) -> None:
    print(f"\r{stage:<12} {share:4.0%}", end="", file=sys.stderr, flush=True)
