"""Segmentation of a large volume: CPU time by part, peak memory and labels, and the same by scipy and scikit-image.

    python -m validation.benchmarks.segmentation [--sizes 256 512] [--peer-sizes 256]

Ellipsoids 22 voxels across fill a cylinder (`packed_cylinder`), voxelised with partial volumes, blurred by 0.7 voxel,
with 5 % noise.  The peer calls `threshold_otsu`, `binary_fill_holes`, filters, `distance_transform_edt`, `watershed` of
the distance and of the attenuation on the whole volume, and joins peaks that rise by less than a voxel above their
saddle (`h_maxima`), as the examples of scikit-image do.  Each run is a process of its own, which compiles on a small
volume first; its peak is the largest resident memory less what it held before, the volume included.  Labels are
compared with the truth.  Writes ``validation/benchmarks/results/segmentation.md``; ends with code 1 if segmentation
takes more than its CPU time or memory a voxel, or finds fewer grains than there are.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.filters import threshold_otsu
from skimage.morphology import h_maxima
from skimage.segmentation import watershed

from grainmotion.model.volume import Volume
from grainmotion.segmentation.segment import segment
from validation.benchmarks.packed_cylinder import voxelised_cylinder
from validation.benchmarks.peers.environment import ROOT, machine

RESULT = Path(__file__).parent / "results" / "segmentation.md"
NANOSECONDS_BAR = 60e9 / 512**3
"""CPU time a voxel, ns: 60 s for 512³."""
BYTES_BAR, BYTES_OF_RUN = 12, 150e6
"""Memory a voxel beside the volume, and in any case: tables of threads."""
BLUR, NOISE = 0.7, 0.05
SMALL = 64
"""Edge of the volume on which everything is compiled."""
OURS, PEER = "grainmotion", "scipy and scikit-image"
Labels = NDArray[np.int32]
Parts = dict[str, float]


def scanned(size: int) -> tuple[NDArray[np.float32], Labels]:
    """The volume and the true labels."""
    volume, labels = voxelised_cylinder(size)
    array = ndimage.gaussian_filter(volume.array, BLUR)
    rng = np.random.default_rng(0)
    for plane in array:
        plane += (NOISE * 0.05 * rng.standard_normal(plane.shape)).astype(np.float32)
    return np.maximum(array, 0, out=array), labels


def ours(array: NDArray[np.float32]) -> tuple[Labels, Parts]:
    """Labels, and CPU seconds of each part."""
    parts, last = Parts(), ["", time.process_time()]

    def listen(message: str, _done: int, _total: int) -> None:
        if message != last[0]:
            now = time.process_time()
            if last[0]:
                parts[str(last[0])] = now - float(last[1])
            last[:] = [message, now]

    return segment(Volume(array, 0.1), progress=listen).labels, parts


def peer(array: NDArray[np.float32]) -> tuple[Labels, Parts]:
    """The same by whole-volume calls."""
    parts = Parts()

    def timed(name: str, work: Callable[[], NDArray]) -> NDArray:
        before = time.process_time()
        found = work()
        parts[name] = parts.get(name, 0.0) + time.process_time() - before
        return found

    solid = timed("threshold", lambda: ndimage.binary_fill_holes(array > threshold_otsu(array)))

    def spread() -> NDArray:
        smooth = ndimage.gaussian_filter(array, 1.0)
        return ndimage.maximum_filter(smooth, 3) - ndimage.minimum_filter(smooth, 3)

    timed("phases", spread)  # what looks for uniform voxels
    part = "distances and watershed"
    distance = timed(part, lambda: ndimage.distance_transform_edt(solid).astype(np.float32))
    seeds = timed(part, lambda: ndimage.label(h_maxima(distance, 1.0), np.ones((3, 3, 3)))[0])
    cores = timed(part, lambda: watershed(-distance, seeds, mask=distance > 1.0))
    return timed(part, lambda: watershed(-array, cores, mask=solid)), parts


def quality(truth: Labels, labels: Labels) -> dict[str, float]:
    """Grains found, labels that are none, and voxels in a wrong grain over all of grains, by the best overlap."""
    width = int(labels.max()) + 1
    keys, voxels = np.unique(truth.ravel().astype(np.int64) * width + labels.ravel(), return_counts=True)
    grain, label = keys // width, keys % width
    sizes, own = np.bincount(grain, voxels), np.bincount(label, voxels)
    both = (grain > 0) & (label > 0)
    grain, label, voxels = grain[both], label[both], voxels[both]
    dice = 2 * voxels / (sizes[grain] + own[label])
    of_grain, of_label, home = np.zeros(len(sizes)), np.zeros(width), np.zeros(width, int)
    np.maximum.at(of_grain, grain, dice)
    np.maximum.at(of_label, label, dice)
    order = np.argsort(voxels)
    home[label[order]] = grain[order]
    return {
        "grains": len(sizes) - 1,
        "found": int((of_grain[1:] > 0.5).sum()),
        "spurious": int((of_label[np.unique(label)] <= 0.5).sum()),
        "dice": float(np.median(of_grain[1:])),
        "wrong": float(voxels[home[label] != grain].sum() / sizes[1:].sum()),
    }


def work(program: str, size: int, folder: Path) -> None:
    """One run, in this process; prints what was measured."""
    run = ours if program == OURS else peer
    run(np.ascontiguousarray(np.load(folder / f"{SMALL}.npy")))
    array = np.load(folder / f"{size}.npy")
    before = int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()
    start = time.process_time()
    labels, parts = run(array)
    seconds = time.process_time() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 - before
    del array
    truth = np.load(folder / f"{size}-truth.npy")
    print(json.dumps({"seconds": seconds, "parts": parts, "peak": peak, **quality(truth, labels)}))


def measured(program: str, size: int, folder: Path) -> dict:
    """One run in a process of its own."""
    command = [sys.executable, "-m", "validation.benchmarks.segmentation", "--work", program, str(size), str(folder)]
    found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(found.stdout.splitlines()[-1])


def line(program: str, size: int, found: dict) -> str:
    """A row of the table."""
    parts = " | ".join(f"{found['parts'].get(name, 0.0):.1f}" for name in PARTS)
    return (
        f"| {size}³ | {program} | {found['seconds']:.1f} | {1e9 * found['seconds'] / size**3:.0f} | {parts} | "
        f"{found['peak'] / size**3:.1f} | {found['found']} of {found['grains']}, {found['spurious']} | "
        f"{found['dice']:.4f} | {1e6 * found['wrong']:.0f} |"
    )


PARTS = ("threshold", "phases", "distances and watershed", "bodies")


def main() -> int:
    """Run, write the table, and say whether the bar is met."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", type=int, nargs="*", default=[256, 512], help="voxels along an edge")
    parser.add_argument("--peer-sizes", type=int, nargs="*", default=[256], help="the same for the peer")
    parser.add_argument("--work", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        work(options.work[0], int(options.work[1]), Path(options.work[2]))
        return 0
    rows, met = [], True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for size in sorted({SMALL, *options.sizes, *options.peer_sizes}):
            array, truth = scanned(size)
            np.save(folder / f"{size}.npy", array)
            np.save(folder / f"{size}-truth.npy", truth)
            del array, truth
            for program, sizes in ((PEER, options.peer_sizes), (OURS, options.sizes)):
                if size not in sizes:
                    continue
                found = measured(program, size, folder)
                rows.append(line(program, size, found))
                print(rows[-1], flush=True)
                if program == OURS:
                    met &= 1e9 * found["seconds"] <= NANOSECONDS_BAR * size**3
                    met &= found["peak"] <= BYTES_BAR * size**3 + BYTES_OF_RUN and found["found"] == found["grains"]
    text = "\n".join(
        [
            "# Segmentation of large volumes",
            "",
            "Ellipsoids 22 voxels across in a cylinder, blurred by 0.7 voxel, 5 % noise.  CPU time of all threads;",
            "peak memory beside the volume; labels against the truth.",
            "",
            f"| volume | program | CPU s | ns a voxel | {' | '.join(PARTS)} | bytes a voxel "
            "| grains found, spurious labels | median Dice | voxels in a wrong grain, ppm |",
            "|" + "---|" * (8 + len(PARTS)),
            *rows,
            "",
            f"The bar, at most {NANOSECONDS_BAR:.0f} ns and {BYTES_BAR} bytes a voxel (and {BYTES_OF_RUN / 1e6:.0f} "
            f"MB), all grains found: {'met' if met else 'NOT met'}.",
            "",
            f"{machine()}.  Made by `python -m validation.benchmarks.segmentation`.",
            "",
        ]
    )
    RESULT.parent.mkdir(exist_ok=True)
    RESULT.write_text(text)
    print(text)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
