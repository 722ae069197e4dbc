"""Forward projection of the paper-scale reference scan: grainmotion's two projectors and RTK's Joseph.

    python -m validation.benchmarks.forward_projection [--views 352] [--repeats 2]

The volume is a voxelised lattice of ellipsoids whose line integrals are known in closed form, so that speed is compared
at a known error.  The projectors run in turn on the same volume and views, grainmotion's with kernels compiled for this
processor, and for AVX2 alone (`targets.py`); the cost is CPU time (user + system, all threads) of the projection alone,
the least of the repeats, after compilation.  RTK lives in ``.venv-bench``, made on the first run.  Writes
``validation/benchmarks/results/forward_projection.md``; ends with code 1 if an answer is wrong or grainmotion takes
more than a fifth of RTK's time, two fifths for the exact path, which is no formula of RTK's Joseph.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Projector
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import Sample, Scanner, attenuation_volume, ellipsoid_particle, line_integrals
from validation.benchmarks.peers import rtk
from validation.benchmarks.peers.environment import machine
from validation.benchmarks.targets import leave, part_of, run_for, targets
from validation.common.measures import relative_difference

SCANNER = Scanner((280, 180), 0.508, 150.0, 0.508 * 150.0 / 0.112, 352)  # as simulate.paper_scale
MAX_DIFFERENCE = 1e-4  # between our trilinear projector and RTK's Joseph, relative: the same formula
MAX_ERROR = 0.03  # between voxels and the closed form, relative
RESULT = Path(__file__).parent / "results" / "forward_projection.md"
BARS: dict[Projector, float] = {"trilinear": 0.2, "exact": 0.4}  # of RTK's CPU time
TITLES = {"trilinear": "trilinear", "exact": "exact path"}
PEER = "RTK, Joseph"


def sample() -> Sample:
    """15 ellipsoids about 45 voxels across with a denser core each, in random attitudes."""
    rng = np.random.default_rng(0)
    h = SCANNER.voxel_size
    spots = [(x, y, z) for z in (-108, -54, 0, 54, 108) for x, y in ((-32, -26), (34, -20), (0, 38))]
    particles = [ellipsoid_particle(rng, 45 * h, 0.1, inclusion_attenuation=0.2) for _ in spots]
    rotations = rotation_matrix(rng.normal(size=(len(spots), 3)))
    return Sample(tuple(p.moved(r, h * np.array(s, float)) for p, r, s in zip(particles, rotations, spots)))


def circle(views: int) -> list[float]:
    """Angles of the views, degrees."""
    return [360.0 * k / views for k in range(views)]


def run_part(folder: Path) -> int:
    """grainmotion's projections in this process: CPU seconds and radiographs by each projector."""
    options, given = part_of(folder)
    geometry = SCANNER.geometry(tuple(circle(options["views"])))
    volume = Volume(given["volume"], SCANNER.voxel_size)
    seconds, images = {}, {}
    for projector in BARS:
        project(volume, geometry[:: max(1, len(geometry) // 32)], projector=projector)  # compile
        start = time.process_time()
        images[projector] = project(volume, geometry, projector=projector)
        seconds[projector] = time.process_time() - start
    leave(folder, seconds, images)
    return 0


def main() -> int:
    """Run, write the table, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=SCANNER.reference_views, help="views of the full circle")
    parser.add_argument("--repeats", type=int, default=2, help="runs of each, the fastest counts")
    parser.add_argument("--part", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        return run_part(options.part)
    angles = circle(options.views)
    geometry = SCANNER.geometry(tuple(angles))
    body = sample()
    volume = attenuation_volume(body, SCANNER.grid)
    truth = line_integrals(body, geometry, subsamples=1)

    own = {f"grainmotion, {TITLES[p]}, {target}": p for target in targets() for p in BARS}
    seconds: dict[str, list[float]] = {name: [] for name in (PEER, *own)}
    images: dict[str, NDArray[np.float32]] = {}
    for _ in range(options.repeats):
        images[PEER], cpu, rtk_version = rtk.forward_projection(volume.array, SCANNER, angles)
        seconds[PEER].append(cpu)
        for target in targets():
            times, found = run_for(
                target, "validation.benchmarks.forward_projection", {"views": options.views}, {"volume": volume.array}
            )
            for projector in BARS:
                name = f"grainmotion, {TITLES[projector]}, {target}"
                seconds[name].append(times[projector])
                images[name] = found[projector]

    best = {name: min(s) for name, s in seconds.items()}
    errors = {name: relative_difference(found, truth) for name, found in images.items()}
    apart = {name: relative_difference(found, images[PEER]) for name, found in images.items()}
    same_formula = max(apart[name] for name, projector in own.items() if projector == "trilinear")
    quick = all(best[name] <= BARS[projector] * best[PEER] for name, projector in own.items())
    passed = quick and same_formula < MAX_DIFFERENCE and max(errors.values()) < MAX_ERROR

    nz, ny, nx = volume.shape
    rows = [
        f"| {name} | {best[name]:.1f} | {best[name] / best[PEER]:.3f} | {apart[name]:.1e} | {errors[name]:.4f} |"
        for name in best
    ]
    text = "\n".join(
        [
            "# Forward projection of the reference scan",
            "",
            f"{nz} × {ny} × {nx} voxels, {options.views} cone-beam views of {SCANNER.panel[0]} × "
            f"{SCANNER.panel[1]} pixels, float32.  CPU time of all threads, the least of "
            f"{options.repeats} runs, the projectors in turn.",
            "",
            "| projector | CPU s | of RTK's | difference from RTK | error against the closed form |",
            "|---|---|---|---|---|",
            *rows,
            "",
            "Differences and errors are relative, ‖a − b‖/‖b‖.  The error against the closed form of the",
            "ellipsoids is that of the voxels.",
            "",
            "The bars, of RTK's Joseph: "
            + ", ".join(f"{TITLES[projector]} at most {bar:g}" for projector, bar in BARS.items())
            + f": {'met' if passed else 'NOT met'}.",
            "",
            f"{machine()}, itk-rtk {rtk_version}.  Made by `python -m validation.benchmarks.forward_projection`.",
            "",
        ]
    )
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(text)
    print(text)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
