"""Draw overview.png from a finished run:  python docs/images/make_overview.py EXPERIMENT.toml STATE."""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import grainmotion as gm
from grainmotion.io.results import read_reference

TITLE_GREY = "0.35"


def main(experiment: Path, state: str) -> None:
    """Five panels: labelled slice; measured, simulated and residual radiograph; displacements."""
    results = experiment.parent / "results"
    reference = read_reference(results / "reference.h5")
    motions = gm.read_motions(results / state / "motions.csv")
    grains = gm.grains_from_labels(reference.volume, reference.labels)
    folder = experiment.parent
    scan = gm.read_scan(
        str(folder / state / "*.tif"),
        folder / f"{state}.csv",
        flats=str(folder / "flats/*.tif"),
        darks=str(folder / "darks/*.tif"),
    )
    simulated = gm.simulate_radiographs(grains, motions, scan.geometry)
    measured = scan.line_integrals
    figure, axes = plt.subplots(
        1, 5, figsize=(12, 3.6), width_ratios=[1, 1, 1, 1, 1.25], constrained_layout=True, facecolor="white"
    )
    z = reference.labels.shape[1] // 2
    axes[0].imshow(reference.volume.array[:, z], cmap="gray", origin="lower", vmin=0)
    shown = np.ma.masked_equal(reference.labels[:, z], 0)
    axes[0].imshow(shown % 10, cmap="tab10", origin="lower", alpha=0.55, interpolation="nearest", vmin=0, vmax=9)
    titles = ["reference scan, 352 views:\nsegmented grains", "later state: one of 4\nradiographs"]
    titles += ["simulated from the\nmeasured motions", "residual (±5 %):\nphoton noise"]
    top = float(measured.max())
    axes[1].imshow(measured[0], cmap="gray", origin="lower", vmin=0, vmax=top)
    axes[2].imshow(simulated[0], cmap="gray", origin="lower", vmin=0, vmax=top)
    residual = measured[0] - simulated[0]
    axes[3].imshow(residual, cmap="RdBu_r", origin="lower", vmin=-0.05 * top, vmax=0.05 * top)
    titles += ["motion of every grain\n(×8, colour: rotation)"]
    for axis, title in zip(axes, titles, strict=True):
        axis.set_title(title, fontsize=10, color=TITLE_GREY)
        axis.axis("off")
    _arrows(axes[4], motions)
    figure.savefig(Path(__file__).with_name("overview.png"), dpi=110)


def _arrows(axis: plt.Axes, motions: gm.Motions) -> None:
    c, u = motions.centers, motions.translations - motions.translations.mean(axis=0)
    rotation_deg = np.rad2deg(np.linalg.norm(motions.rotations, axis=1))
    axis.scatter(c[:, 0], c[:, 2], s=900, c=rotation_deg, cmap="viridis", alpha=0.35, linewidths=0)
    arrows = (c[:, 0], c[:, 2], 8 * u[:, 0], 8 * u[:, 2])
    axis.quiver(*arrows, rotation_deg, cmap="viridis", angles="xy", scale_units="xy", scale=1)
    axis.set_aspect("equal")
    axis.margins(0.25)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
