"""Wrong volumes, labels, start files and HDF5 files of other software."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from grainmotion.io.spam import write_ddic_tsv
from validation.accuracy.wrong_input.draft import Draft, Stack, write_hdf5
from validation.accuracy.wrong_input.laboratory import true_volume
from validation.accuracy.wrong_input.rows import FAILED, row


def start_from(draft: Draft, gradient: Stack) -> None:
    """A file of spam with one gradient for all grains."""
    lab = draft.laboratory
    draft.give_volume()
    draft.keys["states"]["initial"] = "start.tsv"

    def write(folder: Path) -> None:
        path = folder / "start.tsv"
        write_ddic_tsv(path, lab.truth, lab.grid(), true_volume(draft.recipe)[1])
        lines = [line.split("\t") for line in path.read_text().splitlines()]
        for k, name in enumerate(f"F{i}{j}" for i in "zyx" for j in "zyx"):
            column = lines[0].index(name)
            for fields in lines[1:]:
                fields[column] = f"{gradient.ravel()[k]:.6f}"
        path.write_text("\n".join("\t".join(fields) for fields in lines) + "\n")

    draft.after.append(write)


START_BEFORE = "read as converged"


@row(
    "silent",
    "start file with mirrored gradients",
    before=START_BEFORE,
    cause=r"warning.*mirrored.*start-file",
    told_by="`start-file`, `initial`",
)
def start_mirrored(draft: Draft) -> None:
    """One axis is mirrored."""
    start_from(draft, np.diag([1.0, 1.0, -1.0]))


@row(
    "silent",
    "start file with zero gradients",
    before=START_BEFORE,
    cause=r"warning.*singular.*start-file",
    told_by="`start-file`, `initial`",
)
def start_zero(draft: Draft) -> None:
    """No gradient was computed."""
    start_from(draft, np.zeros((3, 3)))


@row(
    "silent",
    "start file with gradients of rank 1",
    before=START_BEFORE,
    cause=r"warning.*singular.*start-file",
    told_by="`start-file`, `initial`",
)
def start_rank_one(draft: Draft) -> None:
    """A projection."""
    axis = draft.rng.normal(size=3)
    start_from(draft, np.outer(axis, axis) / (axis @ axis))


@row(
    "silent",
    "HDF5 virtual dataset of the flats with a member missing",
    before="zeros averaged into the flats",
    cause=r"error.*lie in other files, of which",
    told_by="the reader refuses it and names the missing file",
)
def virtual_member_missing(draft: Draft) -> None:
    """Half of the flats are in a file that is not there."""
    flats = draft.flats
    draft.flats, half = flats[:0], len(flats) // 2

    def write(folder: Path) -> None:
        write_hdf5(folder / "part1.h5", d=flats[:half])
        layout = h5py.VirtualLayout(flats.shape, flats.dtype)
        layout[:half] = h5py.VirtualSource("part1.h5", "d", flats[:half].shape)
        layout[half:] = h5py.VirtualSource("part2.h5", "d", flats[half:].shape)
        with h5py.File(folder / "flats.h5", "w") as file:
            file.create_virtual_dataset("d", layout)

    draft.after.append(write)
    draft.keys["reference"]["flats"] = "flats.h5::/d"


@row(
    "silent",
    "given volume 2 % too large",
    before="0.19 voxel (11 sd)",
    cause=r"(error|warning).*(given-volume|grain-scale)",
    told_by="`given-volume` or `grain-scale`, `voxel_size`",
)
def volume_too_large(draft: Draft) -> None:
    """The voxel size of another calibration."""
    draft.give_volume()
    size = draft.keys["volume"]["voxel_size"]
    assert isinstance(size, float)
    draft.keys["volume"]["voxel_size"] = 1.02 * size


@row(
    "silent",
    "a label that holds two grains",
    before="12–14° with sd 0.4°",
    cause=r"(error|warning).*labels",
    told_by="`labels`",
)
def label_of_two(draft: Draft) -> None:
    """Two neighbours have one label."""
    labels = true_volume(draft.recipe)[1].copy()
    centers = draft.laboratory.sample.centers
    first = int(draft.rng.integers(len(centers)))
    distances = np.linalg.norm(centers - centers[first], axis=1)
    second = int(np.argsort(distances)[1])
    labels[labels == second + 1] = first + 1
    draft.give_volume(labels=labels)


VOLUME = r"(error|warning).*volume.*"


@row(
    "blamed",
    "given volume and labels in x y z order",
    before=FAILED,
    cause=VOLUME + "in the order x y z",
    told_by="`given-volume`",
)
def volume_xyz(draft: Draft) -> None:
    """Axes reversed."""
    volume, labels = true_volume(draft.recipe)
    draft.give_volume(volume.transpose(2, 1, 0), labels.transpose(2, 1, 0))


@row(
    "blamed",
    "given volume and labels upside down",
    before=FAILED,
    cause=VOLUME + "upside down",
    told_by="`given-volume`",
)
def volume_upside_down(draft: Draft) -> None:
    """Slices from the top."""
    volume, labels = true_volume(draft.recipe)
    draft.give_volume(volume[::-1], labels[::-1])


@row(
    "blamed",
    "labels alone flipped",
    before=FAILED,
    cause=r"(error|warning).*labels do not lie.*(mirrored|upside down)",
    told_by="`labels`",
)
def labels_flipped(draft: Draft) -> None:
    """Along one axis."""
    axis = int(draft.rng.integers(3))
    draft.give_volume(labels=np.flip(true_volume(draft.recipe)[1], axis))


@row(
    "blamed",
    "given volume of 8-bit grey values",
    before=FAILED,
    cause=VOLUME + "grey values",
    told_by="`given-volume`",
)
def volume_8_bit(draft: Draft) -> None:
    """Scaled to 255."""
    volume = true_volume(draft.recipe)[0]
    draft.give_volume((volume / volume.max() * 255).clip(0, 255).astype(np.uint8))


@row(
    "blamed",
    "given volume of 16-bit grey values, air at 8000",
    before=FAILED,
    cause=VOLUME + "grey values",
    told_by="`given-volume`",
)
def volume_16_bit(draft: Draft) -> None:
    """As a scanner's software leaves it."""
    volume = true_volume(draft.recipe)[0]
    draft.give_volume((8000 + volume / volume.max() * 22000).clip(0, 65535).astype(np.uint16))


@row(
    "blamed",
    "given volume smaller than the sample",
    before=FAILED,
    cause=VOLUME + "smaller than the sample",
    told_by="`given-volume`",
)
def volume_small(draft: Draft) -> None:
    """The middle of it, without labels."""
    part = true_volume(draft.recipe)[0][20:44, 20:44, 20:44]
    draft.give_volume(part)
    draft.without_labels()
    draft.keys["volume"]["shape"] = [24, 24, 24]
