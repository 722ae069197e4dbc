"""The way of the data through the packages, for docs/architecture.md: ``python docs/images/make_architecture.py``."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

INK, PALE, WORK, FILES = "#22303c", "#eef3f7", "#dcebdc", "#f6e7cf"
SIZE = {"title": 10.5, "text": 8.2, "arrow": 8.2}


def box(axes, x, y, width, height, title, text="", color=PALE):
    """A package: its name, and what it does."""
    axes.add_patch(FancyBboxPatch((x, y), width, height, "round,pad=0.02,rounding_size=0.12", fc=color, ec=INK, lw=1.0))
    middle = x + width / 2
    lines = text.count("\n") + 1 if text else 0
    top = y + height / 2 + (0.16 * lines if text else 0)
    axes.text(middle, top, title, ha="center", va="center", size=SIZE["title"], weight="bold", color=INK)
    if text:
        axes.text(middle, top - 0.22, text, ha="center", va="top", size=SIZE["text"], color=INK, linespacing=1.25)


def arrow(axes, start, end, text="", *, at=0.5, shift=(0.0, 0.13), bend=0.0, dashed=False):
    """Data from one package to another, with its record."""
    style = f"arc3,rad={bend}"
    axes.add_patch(
        FancyArrowPatch(
            start, end, arrowstyle="-|>", mutation_scale=12, lw=1.1, color=INK, connectionstyle=style,
            linestyle="--" if dashed else "-", shrinkA=0, shrinkB=0,
        )
    )  # fmt: skip
    x = start[0] + at * (end[0] - start[0]) + shift[0]
    y = start[1] + at * (end[1] - start[1]) + shift[1]
    if text:
        axes.text(x, y, text, ha="center", va="center", size=SIZE["arrow"], style="italic", color=INK)


def draw() -> Figure:
    """The whole figure."""
    figure = Figure(figsize=(12.5, 8.4))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, 15), axes.set_ylim(0, 10.1), axes.axis("off")

    axes.text(0.3, 9.75, "Reference state, once", size=11, weight="bold", color=INK)
    box(axes, 0.3, 8.2, 2.1, 1.2, "experiment, io", "find and read\nthe scan's files", FILES)
    box(axes, 3.6, 8.2, 2.1, 1.2, "preprocessing", "flat field, −log,\nbeam hardening")
    box(axes, 6.7, 8.2, 2.0, 1.2, "calibration", "detector and axis\nas they are")
    box(axes, 9.7, 8.2, 2.1, 1.2, "reconstruction", "ordered subsets,\nSART")
    box(axes, 12.7, 8.2, 2.0, 1.2, "segmentation", "labels, then each\ngrain's voxels")
    arrow(axes, (2.45, 8.8), (3.55, 8.8), "counts")
    arrow(axes, (5.75, 8.8), (6.65, 8.8), "Scan")
    arrow(axes, (8.75, 8.8), (9.65, 8.8), "Geometry")
    arrow(axes, (11.85, 8.8), (12.65, 8.8), "Volume")

    axes.text(0.3, 7.45, "Each later state", size=11, weight="bold", color=INK)
    box(axes, 0.3, 5.9, 2.1, 1.2, "experiment, io", "find and read\n2 to 6 radiographs", FILES)
    box(axes, 0.3, 3.9, 2.1, 1.2, "preprocessing", "the same flat field\nand hardening")
    arrow(axes, (1.35, 5.85), (1.35, 5.15), "counts", shift=(0.42, 0.0))

    style = "round,pad=0.02,rounding_size=0.2"
    axes.add_patch(FancyBboxPatch((3.3, 2.55), 8.3, 4.75, style, fc="white", ec=INK, lw=1.4))
    axes.text(7.45, 6.98, "tracking", ha="center", size=12.5, weight="bold", color=INK)
    axes.text(7.45, 6.66, "initial guess → coarse to fine → global search → refinement → classification",
              ha="center", size=SIZE["text"], color=INK)  # fmt: skip
    box(axes, 3.7, 4.75, 2.2, 1.3, "projection", "each grain's line\nintegrals and their\n6 derivatives", WORK)
    box(axes, 6.4, 4.75, 2.2, 1.3, "objective", "residual, filter,\nresponse, normal\nequations", WORK)
    box(axes, 9.1, 4.75, 2.2, 1.3, "solvers", "damped\nGauss–Newton step,\nblock CG", WORK)
    box(axes, 6.4, 2.85, 2.2, 1.05, "uncertainty", "noise, covariances,\nweak directions", WORK)
    arrow(axes, (5.95, 5.4), (6.35, 5.4))
    arrow(axes, (8.65, 5.4), (9.05, 5.4))
    arrow(axes, (10.2, 4.7), (4.8, 4.7), "Pose, again until it settles", bend=-0.16, shift=(0.0, -0.62))
    arrow(axes, (7.5, 3.35), (7.5, 3.35))
    arrow(axes, (2.45, 4.5), (3.25, 4.5), "Scan")
    arrow(axes, (13.7, 8.15), (11.65, 6.3), "GrainSet", shift=(0.55, -0.1), bend=-0.12)

    box(axes, 12.7, 4.3, 2.0, 1.2, "analysis", "errors against truth,\ndeformed volume,\nresidual images")
    arrow(axes, (11.65, 4.9), (12.65, 4.9), "Motions")
    box(axes, 12.7, 2.3, 2.0, 1.2, "io, report", "CSV, HDF5, VTK,\nspam, HTML page", FILES)
    arrow(axes, (13.7, 4.25), (13.7, 3.55))
    arrow(axes, (11.65, 3.1), (12.65, 3.0), "Motions")

    box(axes, 0.3, 2.45, 2.1, 0.95, "planning", "which views, how\nprecise, how far")
    order = "the order of a run: which stage is done, what it keeps, what it writes"
    box(axes, 0.3, 1.2, 6.0, 0.95, "workflow, cli", order, FILES)
    box(axes, 6.6, 1.2, 4.0, 0.95, "cluster", "the same backends on Dask workers", FILES)
    box(axes, 10.9, 1.2, 3.8, 0.95, "simulate", "samples and radiographs with their truth")
    records = "numba on arrays  <  records: Geometry, Scan, Volume, GrainSet, Motions"
    bottom = f"{records}  <  who computes: processor, GPU, workers"
    box(axes, 0.3, 0.2, 14.4, 0.75, "kernels  <  model  <  backends", bottom, PALE)
    return figure


if __name__ == "__main__":
    draw().savefig(Path(__file__).with_name("architecture.svg"))
