"""Our NDT beside PCL's on the same clouds, in one run: poses, definitions, median times and their ratios.

    python -m tests.benchmarks.ndt_against_pcl [SOURCE TARGET x,y,z,yaw_deg]

Needs Debian's libpcl-dev and g++. Without arguments: the two scans of PCL's own NDT tutorial where they
are at hand, else a generated room. Prints one table; ends with status 1 if a number that has one definition
differs.
"""

from __future__ import annotations

import argparse
import importlib
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np
from scipy.spatial import KDTree

from service.domain.transform import Transform
from tests.benchmarks.ndt_against_pcl.peer import NoPcl, ask, compile_peer
from tests.geometry.rooms import a_case, inside, off
from worker.formats.pcd import read_pcd, write_pcd
from worker.formats.scan import read_scan
from worker.geometry.cloud.point_cloud import PointCloud
from worker.geometry.cloud.voxel_grid import voxel_grid_filter, voxel_index
from worker.geometry.registration.fitness import euclidean_fitness_score, transformation_probability
from worker.geometry.registration.ndt import register_ndt
from worker.geometry.registration.ndt_map import build_ndt_map

SCANS = Path(__file__).resolve().parents[4] / "shared" / "data" / "scans"
TUTORIAL = (SCANS / "room_scan2.pcd", SCANS / "room_scan1.pcd", "1.79387,0.720047,0,39.71")
RESOLUTION, EPSILON, REPEATS = 1.0, 1e-6, 7
SOURCE_STEPS = (0.4, 0.05)
HALLS, HALL_POINTS = 25, 200_000


def timed(work: Callable[[], object]) -> list[float]:
    """Return the seconds of some runs, the first of which has compiled already."""
    work()
    seconds = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return seconds


def same_points_and_labels(program: Path, folder: Path) -> bool:
    """Return whether PCL's PointXYZL holds what was written."""
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 5, 5000).astype(np.uint32)
    cloud = PointCloud(rng.uniform(-50, 50, (5000, 3)).astype(np.float32).astype(np.float64), labels)
    write_pcd(folder / "labels.pcd", cloud)
    answer = ask(program, "labels", folder / "labels.pcd")
    i = np.arange(5000)
    mixed = np.sum((i % 1009 + 1.0) * labels + (i % 997) * cloud.points[:, 0])
    sums = [*cloud.points.sum(axis=0), float(labels.sum()), mixed]
    return answer["points"] == 5000 and bool(np.allclose(answer["sums"], sums, rtol=1e-9))


def inputs(words: list[str]) -> tuple[np.ndarray, np.ndarray, Transform]:
    """Return source, target and guess: as named, or PCL's tutorial, or a generated room."""
    if not words and not TUTORIAL[0].exists():
        case = a_case(1)
        return case.scan.points, inside(2), off(case.truth, 0.3, 0.2, 5.0)
    source, target, guess = words or TUTORIAL
    x, y, z, yaw_deg = map(float, str(guess).split(","))
    clouds = [read_scan(Path(name)).points for name in (source, target)]
    return clouds[0], clouds[1], Transform.from_xyz_yaw(x, y, z, np.deg2rad(yaw_deg))


def halls() -> np.ndarray:
    """Return 5 million points on floors and walls of 25 halls, in the order of a map's voxels."""
    rng = np.random.default_rng(5)
    parts = []
    for k in range(HALLS):
        p = rng.uniform(0.0, 1.0, (HALL_POINTS, 3)) * (40.0, 30.0, 6.0)
        side = rng.integers(0, 5, HALL_POINTS)
        for axis, end in ((0, 0.0), (0, 40.0), (1, 0.0), (1, 30.0), (2, 0.0)):
            p[side == 2 * axis + (end > 0.0), axis] = end
        parts.append(p + rng.normal(0.0, 0.01, p.shape) + (k % 5 * 45.0, k // 5 * 35.0, 0.0))
    points = np.vstack(parts)
    return np.asarray(points[np.lexsort(voxel_index(points, 0.1).T)])


def threads_and_gicp(thin: np.ndarray, full: np.ndarray, guess: Transform) -> None:
    """Print what a second thread brings, and small_gicp's GICP beside us on one, where it is installed."""
    ndt_map = build_ndt_map(full, RESOLUTION)

    def align() -> object:
        return register_ndt(thin, ndt_map, initial=guess, tolerance=1e-4, max_iterations=100)

    took = {}
    for count in (1, min(2, numba.config.NUMBA_NUM_THREADS)):
        numba.set_num_threads(count)
        took[count] = statistics.median(timed(align))
    numba.set_num_threads(1)
    one, more = took[1] * 1e3, took[count] * 1e3
    print(f"threads     1: {one:.1f} ms, {count}: {more:.1f} ms, {one / more:.2f} x")
    try:
        small_gicp = importlib.import_module("small_gicp")
    except ModuleNotFoundError:
        print("small_gicp  is not installed: uv sync --group peers")
        return
    target, tree = small_gicp.preprocess_points(full, 0.01, num_threads=1)
    source, _ = small_gicp.preprocess_points(thin, 0.01, num_threads=1)
    gicp = 1e3 * statistics.median(
        timed(lambda: small_gicp.align(target, source, tree, guess.matrix, num_threads=1, max_iterations=100))
    )
    print(f"GICP        small_gicp {gicp:.1f} ms   Groundplan {one:.1f} ms   {gicp / one:.2f} x")


def big_grid(program: Path, folder: Path) -> None:
    """Print the seconds of building the grid of a map of 5 million points."""
    write_pcd(folder / "halls.pcd", PointCloud.of(halls()))
    few = folder / "few.pcd"
    write_pcd(few, PointCloud.of(read_pcd(folder / "halls.pcd").points[:1000]))
    peer = ask(program, "place", few, folder / "halls.pcd", RESOLUTION, EPSILON, 3, 0, 0, 0, 0)
    points = read_pcd(folder / "halls.pcd").points
    mine = statistics.median(timed(lambda: build_ndt_map(points, RESOLUTION)))
    theirs = statistics.median(peer["grid_s"])
    print(
        f"grid of {len(points)} points: PCL {theirs * 1e3:.0f} ms   Groundplan {mine * 1e3:.0f} ms   "
        f"{mine / theirs:.2f} of PCL's"
    )


def main() -> int:
    """Run all and print the table, on one thread unless it says otherwise."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("words", nargs="*", metavar="SOURCE TARGET x,y,z,yaw_deg")
    source, target, guess = inputs(parser.parse_args().words)
    numba.set_num_threads(1)
    failed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        try:
            program = compile_peer(folder)
        except NoPcl as missing:
            sys.exit(str(missing))
        labels_agree = same_points_and_labels(program, folder)
        write_pcd(folder / "target.pcd", PointCloud.of(target))
        full = read_pcd(folder / "target.pcd").points
        grid_s = timed(lambda: build_ndt_map(full, RESOLUTION))
        ndt_map = build_ndt_map(full, RESOLUTION)
        for step in SOURCE_STEPS:
            write_pcd(folder / "source.pcd", PointCloud.of(voxel_grid_filter(source, step)))
            thin = read_pcd(folder / "source.pcd").points
            files = (folder / "source.pcd", folder / "target.pcd")
            words = (*guess.translation, guess.rpy[2])
            peer = ask(program, "place", *files, RESOLUTION, EPSILON, REPEATS, *words)

            def align(thin: np.ndarray = thin) -> Transform:
                result = register_ndt(thin, ndt_map, initial=guess, tolerance=1e-4, max_iterations=100)
                return result.T_target_source

            failed |= report(peer, align(), grid_s, timed(align), thin, full, labels_agree=labels_agree)
            threads_and_gicp(thin, full, guess)
            print()
        big_grid(program, folder)
    return failed


def report(
    peer: dict[str, object],
    T: Transform,
    grid_s: list[float],
    align_s: list[float],
    thin: np.ndarray,
    full: np.ndarray,
    *,
    labels_agree: bool,
) -> int:
    """Print poses, definitions at PCL's own pose, and times."""
    matrix = np.array(peer["T"], dtype=np.float64)
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    matrix[:3, :3] = u @ vt
    theirs = Transform(matrix)
    for name, pose in (("PCL", theirs), ("Groundplan", T)):
        x, y, z = pose.translation
        roll, pitch, yaw = np.rad2deg(pose.rpy)
        print(f"{name:<11} x {x:.4f} y {y:.4f} z {z:.4f} m", end="   ")
        print(f"yaw {yaw:.3f} pitch {pitch:.3f} roll {roll:.3f} deg")
    apart, turned = theirs.distance_to(T)
    print(f"apart       {apart:.4f} m, {np.rad2deg(turned):.3f} deg")
    print(f"points      source {len(thin)}, target {len(full)}")
    placed = theirs.apply(thin)
    numbers = {
        "tp": transformation_probability(placed, build_ndt_map(full, RESOLUTION)),
        "fitness": euclidean_fitness_score(np.asarray(KDTree(full).query(placed)[0])),
    }
    agree = labels_agree
    for name, value in numbers.items():
        other = float(str(peer[name]))
        agree &= abs(value - other) < 1e-3 * abs(other)
        print(f"{name:<11} PCL {other:.6f}   Groundplan {value:.6f} at PCL's pose")
    print(f"labels      PointXYZL holds the same points and labels: {labels_agree}")
    for name, mine in (("grid_s", grid_s), ("align_s", align_s)):
        a, b = statistics.median(peer[name]), statistics.median(mine)  # type: ignore[call-overload]
        print(f"{name:<11} PCL {a * 1e3:.1f} ms   Groundplan {b * 1e3:.1f} ms   ratio {a / b:.1f} x")
    return 0 if agree else 1


if __name__ == "__main__":
    sys.exit(main())
