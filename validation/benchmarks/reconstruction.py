"""Reconstruction of the paper-scale reference scan: plain SART and the accelerated method.

    python -m validation.benchmarks.reconstruction [--seed 0]

Both get the same scan of 15 gravel stones (voxel-free simulator, SNR 50), stop as they do by default, and are
compared by the residual of the radiographs, ε = ‖b − A x‖/‖b‖ of the final volume, by CPU time (user + system,
all threads), and by how well grains extracted from either volume are tracked.  Writes
``validation/benchmarks/results/reconstruction.md``; ends with code 1 if the accelerated method takes more than a
third of the time, leaves more than 1.01 times ε, or tracks worse by more than a tenth.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from grainmotion.analysis.validation import compare
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import LATER_ANGLES_DEG, Case, paper_scale
from grainmotion.tracking.track import track
from validation.benchmarks.peers.environment import machine
from validation.common.measures import relative_difference

MAX_CPU_RATIO = 1 / 3  # of plain SART's CPU time
MAX_EPSILON_RATIO = 1.01  # times its ε
MAX_ERROR_RATIO = 1.1  # times its errors
STATES = ("shift", "random")
RESULT = Path(__file__).parent / "results" / "reconstruction.md"
METHODS = {"plain SART": ReconstructSettings(method="sart"), "accelerated": ReconstructSettings(method="accelerated")}


def made(scan: Scan, grid: Volume, settings: ReconstructSettings) -> tuple[float, Volume, float]:
    """CPU seconds, the volume and its ε."""
    start = time.process_time()
    volume = reconstruct(scan, grid, settings).volume
    cpu = time.process_time() - start
    return cpu, volume, relative_difference(project(volume, scan.geometry), scan.line_integrals)


def tracked(case: Case, volume: Volume) -> list[tuple[float, float, int]]:
    """Errors (voxels, degrees) and failures of the states, from 4 views and no start."""
    grains = grains_from_labels(volume, segment(volume).labels)
    out = []
    for k, name in enumerate(STATES):
        truth = case.motions[name]
        state = case.state(truth, LATER_ANGLES_DEG[4], 100 + k)
        errors = compare(track(grains, state), truth, case.scanner.voxel_size)
        out.append((errors.translation_rms_voxels, errors.rotation_rms_deg, errors.failures))
    return out


def main() -> int:
    """Run, write the table, and say whether the bars are met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    case = paper_scale(options.seed)
    scan, grid = case.reference(), case.scanner.grid
    few = scan.select(slice(None, None, 16))
    for settings in METHODS.values():
        reconstruct(few, grid, settings)  # compile
    found = {name: made(scan, grid, settings) for name, settings in METHODS.items()}
    errors = {name: tracked(case, volume) for name, (_, volume, _) in found.items()}
    plain, quick = found["plain SART"], found["accelerated"]
    worst = max(
        b / a for old, new in zip(errors["plain SART"], errors["accelerated"]) for a, b in zip(old[:2], new[:2])
    )
    failures = sum(e[2] for each in errors.values() for e in each)
    passed = (
        quick[0] <= MAX_CPU_RATIO * plain[0]
        and quick[2] <= MAX_EPSILON_RATIO * plain[2]
        and worst <= MAX_ERROR_RATIO
        and not failures
    )
    lines = [
        "# Reconstruction of the reference scan",
        "",
        f"{len(scan)} views of {scan.geometry.shape[0]} × {scan.geometry.shape[1]} pixels, "
        f"{' × '.join(map(str, grid.shape))} voxels, seed {options.seed}.  CPU time of all threads; ε of the final "
        "volume; errors of grains tracked from 4 radiographs, rms a component.",
        "",
        "| method | CPU s | of plain SART | ε | " + " | ".join(f"{s}: voxel, °" for s in STATES) + " |",
        "|---|---|---|---|" + "---|" * len(STATES),
    ]
    for name, (cpu, _, epsilon) in found.items():
        cells = " | ".join(f"{u:.4f}, {w:.3f}" for u, w, _ in errors[name])
        lines.append(f"| {name} | {cpu:.1f} | {cpu / plain[0]:.2f} | {epsilon:.5f} | {cells} |")
    lines += [
        "",
        f"The bars, a third of the CPU time at {MAX_EPSILON_RATIO} times ε and {MAX_ERROR_RATIO} times the errors: "
        f"{'met' if passed else 'missed'}.",
        "",
        f"{machine()}.  Made by `python -m validation.benchmarks.reconstruction`.",
        "",
    ]
    RESULT.write_text("\n".join(lines))
    print("\n".join(lines))
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
