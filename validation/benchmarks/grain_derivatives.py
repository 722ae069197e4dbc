"""One grain's radiograph and its derivatives by six motions: grainmotion and DiffDRR's Siddon forward + backward.

    python -m validation.benchmarks.grain_derivatives [--repeats 5]

A 64³ crop seen by 128 × 128 pixels of half a voxel, rotated, in a cone beam: once a stone, whose footprint leaves
pixels free, once a brick that fills the crop.  grainmotion gives the line integral and six derivatives of every
pixel, exact path and trilinear; DiffDRR the line integrals (exact path) and the gradient of one scalar loss.  The cost
is CPU time (user + system, all threads) after compilation, the least of several calls, the programs in rotation; with
derivatives it includes finding the pixels that the grain shades.  Both are measured as this processor's own
instructions allow, and again with those of AVX2 only, in a process of its own.  Line integrals and the loss's gradient
are compared in double precision.  DiffDRR lives in ``.venv-diffdrr``, made on the first run.  Writes
``validation/benchmarks/results/grain_derivatives.md``; ends with code 1 if an answer is wrong or grainmotion is less
than 150 times as fast.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grainmotion._typing import Projector
from grainmotion.kernels.layout import PADDING
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import Grain, GrainSet
from grainmotion.model.pose import Pose
from grainmotion.model.volume import Volume
from grainmotion.projection.footprints import Patches, footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_patches, project_patches
from grainmotion.rotations import rotation_matrix
from validation.benchmarks.peers.environment import DIFFDRR, machine, run_peer
from validation.common.measures import relative_difference

CROP_VOXELS, CROP_PANEL = 64, (128, 128)
VOXEL = 0.1  # mm
SPEED_BAR = 150.0  # times DiffDRR's forward + backward, for either projector and instruction set
MAX_DIFFERENCE = 1e-6  # of line integrals and gradient in double precision, relative; DiffDRR shifts rays by 1e-8
MAX_SINGLE_DIFFERENCE = 1e-5  # line integrals in single precision against double, relative
HAND_VECTORISED = (5.0, 15.0)  # million rays a second on two cores: what a hand-vectorised kernel is said to reach
ROOT = Path(__file__).parents[2]
RESULT = Path(__file__).parent / "results" / "grain_derivatives.md"
TARGETS = {
    "the processor's own": {},
    "AVX2": {
        "NUMBA_CPU_NAME": "znver3",
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(ROOT / ".targets" / "grain-derivatives"),
        "ATEN_CPU_CAPABILITY": "avx2",
    },
}
"""Instructions for which kernels are compiled, and DiffDRR's are taken, and what selects them."""
PEER = "DiffDRR, Siddon forward + backward"
PROJECTORS: tuple[Projector, ...] = ("trilinear", "exact")


@dataclass(frozen=True)
class Scene:
    """A grain in a view: its voxels, where it is, and what was measured there."""

    packed: GrainArrays
    pose: Pose
    geometry: Geometry
    patches: Patches
    measured: NDArray[np.float64]

    @property
    def rays(self) -> int:
        """Pixels that are traced."""
        return int((self.patches.jobs[:, 3] - self.patches.jobs[:, 2]).sum())


def stone() -> NDArray[np.float64]:
    """A convex polyhedron with a texture and soft faces, as large as fits."""
    rng = np.random.default_rng(0)
    z, y, x = np.meshgrid(*[np.arange(CROP_VOXELS) - (CROP_VOXELS - 1) / 2] * 3, indexing="ij")
    radius = CROP_VOXELS / 2 - PADDING - 0.5
    normals = rng.normal(size=(24, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.stack([x, y, z], axis=-1)
    outside = np.maximum(
        (points @ normals.T - radius * rng.uniform(0.75, 1.0, 24)).max(axis=-1),
        np.linalg.norm(points, axis=-1) - radius,
    )
    return (1 + 0.3 * np.sin(0.4 * x) * np.cos(0.3 * y + 0.2 * z)) * np.clip(0.5 - outside, 0, 1)


def brick() -> NDArray[np.float64]:
    """Noise that fills the crop but for the empty voxels around it."""
    return np.pad(np.random.default_rng(1).uniform(0.5, 1.5, (CROP_VOXELS - 2 * PADDING,) * 3), PADDING)


def scene(array: NDArray[np.float64], precision: type) -> Scene:
    """A grain shifted and rotated in a cone beam; the loss compares it with where it was before."""
    grains = GrainSet((Grain(1, Volume(array.astype(precision), VOXEL), np.zeros(3)),))
    packed = GrainArrays.of(grains)
    geometry = Geometry.cone([20.0], CROP_PANEL, 2 * VOXEL, source_to_axis=60.0, source_to_detector=240.0)
    rotation = rotation_matrix(np.array([[0.2, 0.5, -0.3]]))
    before = Pose(np.zeros((1, 3)), rotation)
    measured = assemble(
        project_patches(packed, before, geometry, footprint_patches(packed, before, geometry), "exact"),
        footprint_patches(packed, before, geometry),
        geometry,
    )
    pose = Pose(np.array([[0.07, -0.04, 0.11]]), rotation_matrix(np.array([[0.02, -0.03, 0.04]])) @ rotation)
    return Scene(packed, pose, geometry, footprint_patches(packed, pose, geometry), measured.astype(float))


def least_cpu(work: Callable[[], Any]) -> float:
    """CPU seconds of a call, the least of those that fit in half a second."""
    work()
    times = []
    while sum(times) < 0.5:
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def value_only(case: Scene, projector: Projector) -> Callable[[], Any]:
    """What is timed for line integrals alone."""
    return lambda: project_patches(case.packed, case.pose, case.geometry, case.patches, projector)


def with_derivatives(case: Scene, projector: Projector) -> Callable[[], Any]:
    """What is timed: the patches, then line integrals and derivatives in them."""

    def work() -> Any:
        patches = footprint_patches(case.packed, case.pose, case.geometry)
        return differentiate_patches(case.packed, case.pose, case.geometry, patches, projector)

    return work


def diffdrr(case: Scene, precision: str, folder: Path, repeats: int) -> tuple[dict[str, Any], NDArray[np.float64]]:
    """Result of DiffDRR for a scene: cost and gradient, and its line integrals."""
    arrays = {
        "volume": case.packed.images.reshape(case.packed.shapes[0]),
        "source": case.geometry.source[0],
        "pixels": case.geometry.pixel_positions(0),
        "measured": case.measured[0],
    }
    for name, values in arrays.items():
        np.save(folder / f"{name}.npy", values)
    job = {name: str(folder / f"{name}.npy") for name in (*arrays, "out")} | {
        "voxel_size": VOXEL,
        "corner": case.packed.corners[0].tolist(),
        "position": (case.packed.centers + case.pose.translations)[0].tolist(),
        "matrix": case.pose.matrices[0].tolist(),
        "precision": precision,
        "repeats": repeats,
    }
    reply = run_peer("diffdrr_siddon.py", job, folder, DIFFDRR)
    return reply, np.load(folder / "out.npy").reshape(CROP_PANEL).astype(float)


def ours(case: Scene, projector: Projector) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Line integrals of the whole panel and the gradient of ½ Σ (I − b)²."""
    values, gradients = differentiate_patches(case.packed, case.pose, case.geometry, case.patches, projector)
    image = assemble(values, case.patches, case.geometry)[0].astype(float)
    misfit = image - case.measured[0]
    slope_images = [assemble(s, case.patches, case.geometry)[0].astype(float) for s in gradients]
    return image, np.array([np.vdot(s, misfit) for s in slope_images])


@dataclass
class Measurement:
    """What was measured with some instructions."""

    speeds: list[str]
    answers: list[str]
    ratios: list[float]
    wrong: bool
    peers: str


def measure(repeats: int) -> Measurement:
    """Run both programs, as rows of the tables."""
    found = Measurement([], [], [], False, "")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for grain, array in (("stone", stone()), ("brick", brick())):
            single, double = scene(array, np.float32), scene(array, np.float64)
            peer, peer_image = diffdrr(double, "double", folder, 1)
            image, gradient = ours(double, "exact")
            coarse = [ours(single, p)[0] for p in PROJECTORS]
            fine = [ours(double, p)[0] for p in PROJECTORS]
            apart, gradients = (
                relative_difference(image, peer_image),
                relative_difference(gradient, np.array(peer["gradient"])),
            )
            rounded = max(relative_difference(c, f) for c, f in zip(coarse, fine))
            found.wrong |= apart > MAX_DIFFERENCE or gradients > MAX_DIFFERENCE or rounded > MAX_SINGLE_DIFFERENCE
            found.answers.append(f"{grain} | {apart:.1e} | {gradients:.1e} | {rounded:.1e} |")
            found.peers = f"diffdrr {peer['diffdrr']}, torch {peer['torch']}"

            jobs = {(p, f): f(single, p) for p in PROJECTORS for f in (value_only, with_derivatives)}
            times: dict[Any, list[float]] = {key: [] for key in (PEER, *jobs)}
            for _ in range(repeats):
                times[PEER].append(diffdrr(single, "single", folder, 2)[0]["cpu"])
                for key, work in jobs.items():
                    times[key].append(least_cpu(work))
            peer_cpu = min(times[PEER])
            found.speeds.append(f"{grain} | {PEER} | {1e3 * peer_cpu:.0f} | | 1 |")
            for projector, kind in jobs:
                cpu = min(times[projector, kind])
                what = "value" if kind is value_only else "value and 6 derivatives"
                if kind is with_derivatives:
                    found.ratios.append(peer_cpu / cpu)
                found.speeds.append(
                    f"{grain} | grainmotion, {projector}, {what} | {1e3 * cpu:.2f} | {single.rays / cpu / 1e6:.1f} "
                    f"| {peer_cpu / cpu:.0f} |"
                )
    return found


def measured_with(variables: dict[str, str], repeats: int) -> Measurement:
    """`measure`, in a process with more variables in its environment."""
    command = [sys.executable, "-m", "validation.benchmarks.grain_derivatives", "--rows", "--repeats", str(repeats)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, **variables})
    return Measurement(**json.loads(done.stdout.strip().splitlines()[-1]))


def main() -> int:
    """Run, write the table, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=5, help="rounds of each program, the fastest call counts")
    parser.add_argument("--rows", action="store_true", help="print the rows of one process, as JSON")
    options = parser.parse_args()
    if options.rows:
        print(json.dumps(asdict(measure(options.repeats))))
        return 0
    DIFFDRR.python()
    measured = {target: measured_with(variables, options.repeats) for target, variables in TARGETS.items()}
    passed = all(min(m.ratios) >= SPEED_BAR and not m.wrong for m in measured.values())
    text = "\n".join(
        [
            "# One grain: line integrals and six derivatives",
            "",
            f"A {CROP_VOXELS}³ crop on {CROP_PANEL[0]} × {CROP_PANEL[1]} pixels of half a voxel, float32.  CPU",
            f"time of all threads, the least of {options.repeats} rounds of several calls each; rays are the pixels",
            "that are traced, a second of one core's time.  grainmotion's derivatives are those of every pixel;",
            "DiffDRR's are the gradient of one loss.",
            "",
            "| instructions | grain | program | CPU ms | M rays a core-second | times DiffDRR's speed |",
            "|---|---|---|---|---|---|",
            *(f"| {target} | {row}" for target, m in measured.items() for row in m.speeds),
            "",
            "The exact path in double precision against DiffDRR's, and single against double precision (both",
            "projectors), relative, ‖a − b‖/‖b‖:",
            "",
            "| instructions | grain | line integrals | gradient of ½ Σ (I − b)² by the motions | single precision |",
            "|---|---|---|---|---|",
            *(f"| {target} | {row}" for target, m in measured.items() for row in m.answers),
            "",
            f"A hand-vectorised kernel is said to trace {HAND_VECTORISED[0]:g} to {HAND_VECTORISED[1]:g} million",
            f"rays a second of two cores, {HAND_VECTORISED[0] / 2:g} to {HAND_VECTORISED[1] / 2:g} of one.",
            "",
            f"The bar, both projectors at least {SPEED_BAR:g} times DiffDRR with any instructions: "
            f"{'met' if passed else 'NOT met'}.",
            "",
            f"{machine()}, {next(iter(measured.values())).peers}.  Made by "
            "`python -m validation.benchmarks.grain_derivatives`.",
            "",
        ]
    )
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(text)
    print(text)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
