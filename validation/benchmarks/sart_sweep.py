"""One sweep of SART over the paper-scale reference scan: grainmotion and RTK.

    python -m validation.benchmarks.sart_sweep [--views 352] [--repeats 1]

The scene is that of `forward_projection.py`: closed-form line integrals of 15 ellipsoids.  Both programs start from
zeros and pass once over all views with the same relaxation, the same projector (trilinear, Joseph) and no negative
attenuation; RTK with either of its back-projectors, of which the faster counts.  The cost is CPU time (user + system,
all threads) of the sweep, the least of the repeats, after compilation, the programs in turn; grainmotion's with kernels
compiled for this processor, and for AVX2 alone (`targets.py`).  ε = ‖b − A x‖/‖b‖ of
both volumes is taken after the sweep, by grainmotion's projector.  RTK lives in ``.venv-bench``, made on the first
run.  Writes ``validation/benchmarks/results/sart_sweep.md``; ends with code 1 if grainmotion takes more than
0.06 of RTK's time or its ε is larger.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.simulate import attenuation_volume, line_integrals
from validation.benchmarks.forward_projection import SCANNER, sample
from validation.benchmarks.peers import rtk
from validation.benchmarks.peers.environment import machine
from validation.benchmarks.targets import leave, part_of, run_for, targets
from validation.common.measures import relative_difference

CPU_BAR = 0.06  # of RTK's CPU time
EPSILON_BAR = 1.0  # ε of ours over RTK's smaller one, at most
RELAXATION = 1.0
SWEEP = ReconstructSettings(sweeps=1, relaxation=RELAXATION, hardening=False)  # no look for beam hardening
RESULT = Path(__file__).parent / "results" / "sart_sweep.md"
PEERS = {"RTK, back-projection by Joseph": "joseph", "RTK, back-projection by voxels (its default)": "voxels"}


def circle(views: int) -> list[float]:
    """Angles of the views, degrees."""
    return [360.0 * k / views for k in range(views)]


def run_part(folder: Path) -> int:
    """grainmotion's sweep in this process: CPU seconds and volume."""
    options, given = part_of(folder)
    scan, grid = Scan(given["radiographs"], SCANNER.geometry(tuple(circle(options["views"])))), SCANNER.grid
    reconstruct(scan.select(slice(None, None, max(1, options["views"] // 8))), grid, SWEEP)  # compile
    start = time.process_time()
    found = reconstruct(scan, grid, SWEEP)
    leave(folder, {"sweep": time.process_time() - start}, {"volume": found.volume.array})
    return 0


def ours(target: str, scan: Scan) -> tuple[float, NDArray[np.float32]]:
    """CPU seconds and volume."""
    radiographs = {"radiographs": scan.line_integrals}
    seconds, found = run_for(target, "validation.benchmarks.sart_sweep", {"views": len(scan)}, radiographs)
    return seconds["sweep"], found["volume"]


def main() -> int:
    """Run, write the table, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=SCANNER.reference_views, help="views of the full circle")
    parser.add_argument("--repeats", type=int, default=1, help="runs of each, the fastest counts")
    parser.add_argument("--part", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        return run_part(options.part)
    angles = circle(options.views)
    geometry: Geometry = SCANNER.geometry(tuple(angles))
    body, grid = sample(), SCANNER.grid
    scan = Scan(line_integrals(body, geometry, subsamples=1).astype(np.float32), geometry)
    truth = attenuation_volume(body, grid).array
    own = {f"grainmotion, {target}": target for target in targets()}

    seconds: dict[str, list[float]] = {name: [] for name in (*PEERS, *own)}
    volumes: dict[str, NDArray[np.float32]] = {}
    for _ in range(options.repeats):
        for name, back_projector in PEERS.items():
            volumes[name], cpu, rtk_version = rtk.sart_sweep(
                scan.line_integrals, SCANNER, angles, RELAXATION, back_projector
            )
            seconds[name].append(cpu)
        for name, target in own.items():
            cpu, volumes[name] = ours(target, scan)
            seconds[name].append(cpu)

    best = {name: min(s) for name, s in seconds.items()}
    residuals = {
        name: relative_difference(project(Volume(v, grid.voxel_size, grid.center), geometry), scan.line_integrals)
        for name, v in volumes.items()
    }
    errors = {name: relative_difference(v, truth) for name, v in volumes.items()}
    peer = min(best[name] for name in PEERS)
    least = min(residuals[name] for name in PEERS)
    passed = all(best[name] <= CPU_BAR * peer and residuals[name] <= EPSILON_BAR * least for name in own)

    nz, ny, nx = grid.shape
    rows = [
        f"| {name} | {best[name]:.1f} | {best[name] / peer:.3f} | {residuals[name]:.4f} | {errors[name]:.4f} |"
        for name in best
    ]
    text = "\n".join(
        [
            "# One sweep of SART over the reference scan",
            "",
            f"{nz} × {ny} × {nx} voxels, {options.views} cone-beam views of {SCANNER.panel[0]} × "
            f"{SCANNER.panel[1]} pixels, float32, λ = {RELAXATION:g}, from zeros.  CPU time of all threads, the",
            f"least of {options.repeats}, the programs in turn.",
            "",
            "| program | CPU s | of RTK's faster | ε after the sweep | error of the volume |",
            "|---|---|---|---|---|",
            *rows,
            "",
            "ε = ‖b − A x‖/‖b‖ by grainmotion's projector; the error of the volume is against the voxelised truth,",
            "‖x − x₀‖/‖x₀‖.",
            "",
            f"The bar, at most {CPU_BAR:g} of RTK's CPU time at no larger ε: {'met' if passed else 'NOT met'}.",
            "",
            f"{machine()}, itk-rtk {rtk_version}.  Made by "
            f"`python -m validation.benchmarks.sart_sweep --views {options.views}`.",
            "",
        ]
    )
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(text)
    print(text)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
