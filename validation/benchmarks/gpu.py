"""GPU against CPU: SART at the paper's scale, and states of many grains.

    python -m validation.benchmarks.gpu [--grains 1000 10000] [--compare 1000] [--repeats 3]

Both do the same work in the same run: one sweep of SART (352 cone-beam views of 280 × 180 pixels, 280 × 180 × 180
voxels), and the tracking of a state of so many grains in 4 views.  The GPU's cost is wall time from the host's
arrays to the host's arrays, after compilation, the least of the repeats; the CPU's is CPU time of all threads
and wall time.  States of more than ``--compare`` grains are left to the GPU alone.  Answers are compared.

Kernels are timed one by one.  The bytes that each is known to ask for (a voxel read at every sample, a pixel at every
tap), over its time, are given as a share of what a kernel that only copies moves on this GPU; caches serve many of
them, so the share can exceed 1.

Writes ``validation/benchmarks/results/gpu.md``.  Ends with code 1 if an answer is wrong or a goal is missed, with
code 2 and no table where there is no GPU.  ``--toy`` does little work and writes nothing: a test runs it in CUDA's
simulator.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba as nb
import numpy as np

from grainmotion.backends.device import backend_of
from grainmotion.errors import BackendError
from grainmotion.kernels.layout import PADDING
from grainmotion.kernels.ray_tracing import enter, pixel_ray
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.pose import Pose
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.objective.data_term import gaussian
from grainmotion.objective.normal_matrix import PatchNormalMatrix, normal_matrix
from grainmotion.projection.footprints import footprint_patches
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.grains import assemble, differentiate_in_place, simulate_radiographs
from grainmotion.projection.volume_operator import padded_origin
from grainmotion.projection.volumes import project
from grainmotion.reconstruction.reconstruct import ReconstructSettings, reconstruct
from grainmotion.reconstruction.system import golden_order
from grainmotion.rotations import rotation_vector
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.tracking.track import TrackSettings, track
from validation.benchmarks.crowd import Crowd, crowd
from validation.benchmarks.peers.environment import machine

RESULT = Path(__file__).parent / "results" / "gpu.md"
SWEEP_GOAL, STATE_GOAL = 1.0, 10.0  # seconds: a sweep of 352 views; a state of 1,000 grains
MAX_VOXEL_DIFFERENCE = 1e-4  # of the largest voxel, between GPU and CPU after a sweep
MAX_MOTION_DIFFERENCE = 0.01  # voxels that a grain's centre or surface may lie apart
FILTER_SIGMA = 2.0  # pixels: the filter under which the patches' kernels are timed
ANGLES_DEG = (0.0, 45.0, 90.0, 135.0)


@dataclass(frozen=True, eq=False)
class Case:
    """Grains, a later state of them and where it really is."""

    grains: GrainSet
    scan: Scan
    truth: Motions


def lattice(n: int, across: int, seed: int = 0) -> Case:
    """``n`` textured lumps on a lattice, each moved its own way; radiographs by the package's own projector."""
    rng = np.random.default_rng(seed)
    side, h = int(np.ceil(n ** (1 / 3))), 1.0 / across
    step, size = across + 4, side * (across + 4)
    volume, labels = np.zeros((size, size, size), np.float32), np.zeros((size, size, size), np.int32)
    z, y, x = np.meshgrid(*[np.arange(step) - (step - 1) / 2] * 3, indexing="ij")
    for label in range(1, n + 1):
        stretch = rng.uniform(0.75, 1.0, 3) * across / 2
        distance = np.sqrt((x / stretch[0]) ** 2 + (y / stretch[1]) ** 2 + (z / stretch[2]) ** 2)
        wave = rng.normal(size=3) * 4 / across
        lump = np.clip((1 - distance) * stretch.min(), 0, 1) * (
            1 + 0.3 * np.sin(x * wave[0] + y * wave[1] + z * wave[2])
        )
        k, j, i = step * np.array(np.unravel_index(label - 1, (side, side, side)))
        box = slice(k, k + step), slice(j, j + step), slice(i, i + step)
        volume[box], labels[box] = lump, np.where(lump > 0, label, 0)
    grains = grains_from_labels(Volume(volume, h), labels, reach=0, finer=1)
    width = int(1.5 * size) + 8
    views = Geometry.cone(ANGLES_DEG, (size + 8, width), 4 * h, source_to_axis=12 * size * h,
                          source_to_detector=48 * size * h)  # fmt: skip
    truth = Motions.identity(grains.labels, grains.centers)
    rotations = np.deg2rad(4) * rng.uniform(-1, 1, (n, 3))
    truth = Motions(**{**truth.__dict__, "translations": h * rng.uniform(-2, 2, (n, 3)), "rotations": rotations})
    images = simulate_radiographs(grains, truth, views)
    images += 0.002 * float(images.max()) * rng.standard_normal(images.shape, dtype=np.float32)
    return Case(grains, Scan(images, views), truth)


def least(work: Callable[[], Any], repeats: int) -> float:
    """Least wall seconds of some work, with all that the GPU still does."""
    from numba import cuda

    work()
    times = []
    for _ in range(repeats):
        cuda.synchronize()
        start = time.perf_counter()
        work()
        cuda.synchronize()
        times.append(time.perf_counter() - start)
    return min(times)


def costs(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """What some work of the CPU returns, its CPU and its wall seconds."""
    cpu, wall = time.process_time(), time.perf_counter()
    out = work()
    return out, time.process_time() - cpu, time.perf_counter() - wall


def copied(repeats: int, size: int) -> float:
    """Bytes a second that a kernel reads and writes when it copies ``size`` numbers."""
    from grainmotion.kernels.cuda.device_array import upload

    return 8 * size / least(upload(np.zeros(size, np.float32)).copy, repeats)


@nb.njit(cache=True)
def samples(origin, voxel, views, cone, rows, columns, nx, ny, nz):
    """Planes of voxels that all rays of all views cross inside a volume: the samples of one projection."""
    total, h = 0, 1.0 / voxel
    for view in views:
        for r in range(rows):
            for c in range(columns):
                px, py, pz, dx, dy, dz = pixel_ray(view, cone, r - (rows - 1) / 2, c - (columns - 1) / 2)
                o = ((px - origin[0]) * h, (py - origin[1]) * h, (pz - origin[2]) * h)
                total += enter(o[0], o[1], o[2], dx * h, dy * h, dz * h, nx, ny, nz, False)[2]
    return total


def sweep_case(toy: bool) -> tuple[Scan, Volume]:
    """The paper's scan of a cylinder of blobs, as `simulate.paper_scale` places it."""
    shape, panel, views = ((6, 6, 6), (6, 6), 4) if toy else ((280, 180, 180), (280, 180), 352)
    h = 0.112
    z, y, x = (np.arange(n) - (n - 1) / 2 for n in shape)
    inside = x[None, None, :] ** 2 + y[None, :, None] ** 2 < (0.45 * shape[1]) ** 2
    waves = np.cos(0.2 * x)[None, None, :] * np.cos(0.17 * y)[None, :, None] * np.cos(0.13 * z)[:, None, None]
    sample = Volume((0.1 * inside * (1.2 + waves)).astype(np.float32), h)
    angles = np.arange(views) * 360 / views
    geometry = Geometry.cone(angles, panel, 0.508, source_to_axis=150.0, source_to_detector=0.508 * 150.0 / h)
    return Scan(project(sample, geometry), geometry), Volume.zeros(shape, h)


def volume_rows(options: argparse.Namespace, copy: float) -> tuple[list[str], bool]:
    """SART: the sweep on both, and its kernels."""
    scan, grid = sweep_case(options.toy)
    settings = {name: ReconstructSettings(method="sart", sweeps=1, device=name) for name in ("cpu", "cuda")}
    reconstruct(scan.select(slice(0, 1)), grid, settings["cpu"])  # compile
    host, cpu, wall = costs(lambda: reconstruct(scan, grid, settings["cpu"]))
    found = reconstruct(scan, grid, settings["cuda"])
    whole = least(lambda: reconstruct(scan, grid, settings["cuda"]), options.repeats)
    apart = np.abs(found.volume.array - host.volume.array).max() / host.volume.array.max()
    from grainmotion.reconstruction.iterate_cuda import CudaIterate

    iterate, order = CudaIterate(scan, grid, settings["cuda"]), golden_order(len(scan))

    def sweep() -> None:
        for view in order:
            iterate.update(np.array([view]), 0.01)

    once = least(sweep, options.repeats)
    forward = least(lambda: iterate.operator.forward(iterate.image), options.repeats)
    fast = {name: ReconstructSettings(method="accelerated", device=name) for name in ("cpu", "cuda")}
    on_host, cpu_all, wall_all = (
        costs(lambda: reconstruct(scan, grid, fast["cpu"])) if not options.toy else (host, 0.0, 0.0)
    )
    quick = reconstruct(scan, grid, fast["cuda"]) if not options.toy else found
    whole_all = least(lambda: reconstruct(scan, grid, fast["cuda"]), options.repeats) if not options.toy else 0.0
    apart_all = np.abs(quick.volume.array - on_host.volume.array).max() / on_host.volume.array.max()
    nz, ny, nx = (n + 2 * PADDING for n in grid.shape)
    count = samples(padded_origin(grid), grid.voxel_size, scan.geometry.vectors, True, *scan.geometry.shape, nx, ny, nz)
    asked = {"forward": 16 * count, "sweep": 16 * count + 32 * count + 8 * nx * ny * nz * len(scan)}
    lines = [
        f"| one sweep from and to the host | {cpu:.1f} | {wall:.1f} | {whole:.3f} | {apart:.1e} | |",
        f"| one sweep, all on the GPU | | | {once:.3f} | | {asked['sweep'] / once / copy:.2f} |",
        f"| the default reconstruction, from and to the host | {cpu_all:.1f} | {wall_all:.1f} | {whole_all:.3f} "
        f"| {apart_all:.1e} | |",
        f"| line integrals of all views, to the host | | | {forward:.3f} | | {asked['forward'] / forward / copy:.2f} |",
    ]
    return lines, max(apart, apart_all) <= MAX_VOXEL_DIFFERENCE and (options.toy or once <= SWEEP_GOAL)


def patch_rows(case: Case | Crowd, options: argparse.Namespace, copy: float) -> list[str]:
    """The kernels of one linearisation of a state, one by one."""
    backend, views = backend_of("cuda"), case.scan.geometry
    packed = GrainArrays.of(case.grains).on(backend)
    pose = Pose(np.zeros((len(packed), 3)), np.tile(np.eye(3), (len(packed), 1, 1)))
    kernel = gaussian(0.3 if options.toy else FILTER_SIGMA).astype(np.float32)
    patches = footprint_patches(packed, pose, views, margin=len(kernel) - 1)
    images, valid = case.scan.line_integrals.astype(np.float32), np.ones(case.scan.line_integrals.shape, np.float32)
    values, jacobian = differentiate_in_place(packed, pose, views, patches, "trilinear")
    pixels, traced = jacobian.derivatives.shape[1], int((patches.jobs[:, 3] - patches.jobs[:, 2]).sum())
    crossed = float(np.median(packed.shapes[:, 0] - 2 * PADDING)) * traced  # about the planes of a grain a ray
    taps = 2 * len(kernel) - 1
    found = {
        "values and derivatives": (
            lambda: differentiate_in_place(packed, pose, views, patches, "trilinear"),
            16 * crossed + 28 * traced + 28 * pixels,
        ),
        "radiographs": (lambda: assemble(values, patches, views, backend), 4 * pixels + 8 * images.size),
        "filter of radiographs": (lambda: backend.filter_images(images.copy(), kernel), (8 * taps + 8) * images.size),
        "filter of derivatives": (
            lambda: jacobian.filter(valid, kernel),
            6 * (8 * taps + 20) * pixels,
        ),
        "gradient": (
            lambda: jacobian.vjp([images]),
            28 * pixels,
        ),
    }
    product = PatchNormalMatrix(jacobian)
    step = np.ones(6 * len(packed))
    found["product with the normal matrix"] = (lambda: product @ step, 52 * pixels + 8 * images.size)
    if len(packed) <= options.compare:
        found["6 × 6 blocks"] = (lambda: normal_matrix(jacobian), None)
    lines = []
    for name, (work, asked) in found.items():
        seconds = least(work, options.repeats)
        share = "" if asked is None else f"{asked / seconds / copy:.2f}"
        lines.append(f"| {len(packed)} | {name} | {1e3 * seconds:.2f} | {share} |")
    return lines


def apart(one: Motions, other: Motions, grains: GrainSet) -> float:
    """How far centres and surfaces of grains lie apart at most, voxels, whatever became of them."""
    reach = GrainArrays.of(grains).radii
    rotations = np.linalg.norm(rotation_vector(one.matrices @ np.swapaxes(other.matrices, 1, 2)), axis=1)
    distances = np.linalg.norm(one.translations - other.translations, axis=1) + reach * rotations
    return float(np.nanmax(distances)) / grains.voxel_size


def state_row(case: Case | Crowd, options: argparse.Namespace) -> tuple[str, bool]:
    """A state on both devices."""
    n = len(case.grains)
    settings = TrackSettings(device="cuda", search=not options.toy)
    if options.toy:
        settings = TrackSettings(device="cuda", filters=(0.0,), fields=False, search=False, view_corrections="never",
                                 gain="none", trend="none", iterations=1)  # fmt: skip
    start = time.perf_counter()
    found = track(case.grains, case.scan, settings=settings)
    seconds = time.perf_counter() - start
    error = apart(found, case.truth, case.grains)
    cells, passed = "| | | ", True
    if n <= options.compare:
        on_host = TrackSettings(**{**settings.__dict__, "device": "cpu"})
        host, cpu, wall = costs(lambda: track(case.grains, case.scan, settings=on_host))
        distance = apart(found, host, case.grains)
        cells = f"| {cpu:.1f} | {wall:.1f} | {distance:.1e} "
        passed = distance <= MAX_MOTION_DIFFERENCE and list(found.statuses) == list(host.statuses)
    passed = passed and (n != 1000 or seconds <= STATE_GOAL)
    return f"| {n} | {seconds:.2f} {cells}| {int(found.ok.sum())} | {error:.3f} |", passed


def gpu_name() -> str:
    """Its name, or that there is none but its simulator."""
    from numba import config, cuda

    if config.ENABLE_CUDASIM:
        return "CUDA's simulator: times mean nothing"
    name = cuda.get_current_device().name
    return name.decode() if isinstance(name, bytes) else str(name)


def main(arguments: list[str] | None = None) -> int:
    """Run everything, write the table, and say whether answers are right and goals are met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grains", type=int, nargs="+", default=[1000, 10000])
    parser.add_argument("--across", type=int, default=14, help="voxels across a grain of --toy")
    parser.add_argument("--compare", type=int, default=1000, help="most grains that the CPU tracks, too")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--toy", action="store_true", help="little work, no table written")
    options = parser.parse_args(arguments)
    try:
        backend_of("cuda")
    except BackendError as error:
        print(f"no GPU benchmark, and no table: {error}", file=sys.stderr)
        return 2
    copy = copied(options.repeats, 2**10 if options.toy else 2**28)
    lines, passed = volume_rows(options, copy)
    kernels, states = list[str](), list[str]()
    for n in options.grains:
        case: Case | Crowd = lattice(n, options.across) if options.toy else crowd(n)
        if n == options.grains[0] and not options.toy:  # compile
            track(case.grains, case.scan, settings=TrackSettings(device="cuda", search=False))
        kernels += patch_rows(case, options, copy)
        row, right = state_row(case, options)
        states.append(row)
        passed = passed and right
    text = "\n".join(
        [
            "# GPU against CPU",
            "",
            f"GPU: {gpu_name()}.  A kernel that copies moves {copy / 1e9:.0f} GB/s on it (read and written).",
            "",
            "| SART at the paper's scale | CPU, CPU s | wall s | GPU, s | apart | share of copy |",
            "|---|---|---|---|---|---|",
            *lines,
            "",
            "| grains | GPU, s | CPU, CPU s | wall s | apart, voxels | converged | farthest from truth |",
            "|---|---|---|---|---|---|---|",
            *states,
            "",
            "| grains | kernel of a linearisation, with transfers | ms | share of copy |",
            "|---|---|---|---|",
            *kernels,
            "",
            f"Goals: a sweep on the GPU ≤ {SWEEP_GOAL:g} s, a state of 1,000 grains ≤ {STATE_GOAL:g} s: "
            + ("met." if passed else "NOT all met, or an answer is wrong."),
            "",
            f"{machine()}.  Made by `python -m validation.benchmarks.gpu`.",
            "",
        ]
    )
    print(text)
    if not options.toy:
        RESULT.parent.mkdir(exist_ok=True)
        RESULT.write_text(text)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
