"""How many updates of a volume suffice to track its grains as well.

    python -m validation.benchmarks.updates [--size 320]

N³ voxels, N views of N × N pixels and gravel stones 22 voxels across on a jittered lattice, simulated without voxels
(SNR about 50).  The same scan is reconstructed by the coarse start alone, by a part of the updates of the accelerated
method, by all of them (the default), and by plain SART.  Each volume is segmented and its grains are tracked from 4
radiographs of a state in which each moved by up to 2 voxels and 4° on its own.  Writes
``validation/benchmarks/results/updates.md``; ends with code 1 if the default tracks worse by more than a tenth than
plain SART.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from grainmotion.analysis.validation import compare
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.coarse_start import started
from grainmotion.reconstruction.iterate import new_iterate
from grainmotion.reconstruction.ordered_subsets import PHASES, accelerated, plain_sart
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import Iterate
from grainmotion.rotations import rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.segmentation.segment import segment
from grainmotion.simulate import Particle, Sample, motion_fields, stone
from grainmotion.simulate.detector import Physics, record_line_integrals
from grainmotion.simulate.scenarios import STONE_COUNT
from grainmotion.tracking.track import track
from validation.benchmarks.peers.environment import machine
from validation.common.measures import relative_difference

RESULT = Path(__file__).parent / "results" / "updates.md"
ACROSS, SPACING, FILLED_RADIUS = 22.0, 1.25, 0.4
"""Voxels across a stone; distance of neighbours over it; radius of the sample over the edge of the volume."""
VOXEL, LONGEST, PHOTONS, MESH_LEVEL = 0.1, 1.5, 2e4, 2
"""mm; line integral through the middle; photons a pixel; subdivisions of a stone's mesh."""
SHIFT, TURN_DEG, ANGLES_DEG = 2.0, 4.0, (0.0, 45.0, 90.0, 135.0)
MAX_ERROR_RATIO = 1.1
SETTINGS = ReconstructSettings(method="accelerated", outline="grid")
Method = Callable[[Iterate, int], list[float]]


def _first(updates: int) -> Method:
    """The first updates of the default's first phase."""
    return lambda iterate, views: accelerated(iterate, views, None, ((updates, *PHASES[0][1:]),))


METHODS: dict[str, Method] = {
    "coarse start alone": lambda _iterate, _views: [],
    "11 updates": _first(11),
    "22 updates": _first(22),
    "44 updates": _first(44),
    "44 + 8 updates, the default": lambda iterate, views: accelerated(iterate, views, None),
    "plain SART, 6 sweeps": lambda iterate, views: plain_sart(
        iterate, views, ReconstructSettings(method="sart", tolerance=0), None
    ),
}
DEFAULT, MANY = "44 + 8 updates, the default", "plain SART, 6 sweeps"


@dataclass(frozen=True)
class Case:
    """A sample with its full scan, a later state of it, and the truth of that."""

    scan: Scan
    grid: Volume
    state: Scan
    truth: Motions

    @classmethod
    def of(cls, size: int) -> Case:
        """Simulate it."""
        whole = sample(size)
        moved = motion_fields.random(whole, SHIFT * VOXEL, TURN_DEG, 1)
        to_axis, physics = 200.0 * size / 512, Physics(photons=PHOTONS)

        def views(angles: tuple[float, ...]) -> Geometry:
            shape = (size, size)
            return Geometry.cone(angles, shape, 2 * VOXEL, source_to_axis=to_axis, source_to_detector=2 * to_axis)

        scan = record_line_integrals(whole, views(tuple(360.0 * k / size for k in range(size))), physics, 2)
        state = record_line_integrals(whole.moved(moved), views(ANGLES_DEG), physics, 3)
        return cls(scan, Volume.zeros((size, size, size), VOXEL), state, moved)


def sample(size: int) -> Sample:
    """Stones in a cylinder."""
    rng, radius, step = np.random.default_rng(0), FILLED_RADIUS * size, SPACING * ACROSS
    line = np.arange(-radius, radius + 1, step)
    places = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    places += rng.uniform(-0.8, 0.8, places.shape)
    places = places[(np.hypot(*places[:, :2].T) < radius - ACROSS / 2) & (np.abs(places[:, 2]) < radius - ACROSS / 2)]
    share = len(places) * np.pi / 6 * ACROSS**3 / (2 * np.pi * radius**3)
    attenuation = LONGEST / (share * 2 * radius * VOXEL)
    shapes = [stone(k % STONE_COUNT, ACROSS * VOXEL, MESH_LEVEL) for k in range(len(places))]
    turns = rotation_matrix(rng.normal(size=places.shape))
    return Sample(
        tuple(
            Particle(shape, attenuation).moved(turn, VOXEL * place) for shape, turn, place in zip(shapes, turns, places)
        )
    )


def measured(case: Case, method: Method) -> tuple[float, float, float, float, int]:
    """CPU seconds, ε of the final volume, errors of the motions (voxel, degree) and failures."""
    start = time.process_time()
    begin = new_iterate if method is METHODS[MANY] else started
    iterate = begin(case.scan, case.grid, SETTINGS)
    method(iterate, len(case.scan))
    volume = iterate.into_volume()
    seconds = time.process_time() - start
    epsilon = relative_difference(project(volume, case.scan.geometry), case.scan.line_integrals)
    grains = grains_from_labels(volume, segment(volume).labels)
    errors = compare(track(grains, case.state), case.truth, VOXEL)
    return seconds, epsilon, errors.translation_rms_voxels, errors.rotation_rms_deg, errors.failures


def main() -> int:
    """Run, write the table, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--size", type=int, default=320, help="edge of the volume, voxels; as many views")
    options = parser.parse_args()
    case = Case.of(options.size)
    few = case.scan.select(slice(None, None, 16))
    accelerated(started(few, case.grid, SETTINGS), len(few), None, ((2, 1, 1.0, 1.0),))  # compile
    found = {}
    for name, method in METHODS.items():
        found[name] = measured(case, method)
        print(name, *(f"{value:.4g}" for value in found[name]), flush=True)
    passed = all(a <= MAX_ERROR_RATIO * b for a, b in zip(found[DEFAULT][2:4], found[MANY][2:4], strict=True))
    lines = [
        "# Updates of a volume, and how well its grains are tracked",
        "",
        f"{options.size}³ voxels, {options.size} views of {options.size}² pixels, {len(case.truth.labels)} stones of "
        f"{ACROSS:g} voxels, simulated without voxels, {PHOTONS:.0e} photons a pixel.  CPU time of all threads for the "
        "reconstruction; ε = ‖b − A x‖/‖b‖ of the final volume; errors of grains tracked from 4 radiographs, root mean "
        "square a component, and grains that failed.",
        "",
        "| reconstruction | CPU s | ε | voxel | ° | failed |",
        "|---|---|---|---|---|---|",
        *(
            f"| {name} | {cpu:.1f} | {epsilon:.5f} | {u:.4f} | {w:.3f} | {failures} |"
            for name, (cpu, epsilon, u, w, failures) in found.items()
        ),
        "",
        f"The bar, errors of the default at most {MAX_ERROR_RATIO} times those of plain SART: "
        f"{'met' if passed else 'NOT met'}.",
        "",
        f"{machine()}.  Made by `python -m validation.benchmarks.updates --size {options.size}`.",
        "",
    ]
    RESULT.write_text("\n".join(lines))
    print("\n".join(lines))
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
