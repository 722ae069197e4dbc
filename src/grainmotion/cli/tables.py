"""Tables of inspections, comparisons and plans on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from grainmotion.cli.terminal import Terminal

if TYPE_CHECKING:
    from rich.console import Console

    from grainmotion.analysis.validation import Comparison
    from grainmotion.experiment.inspection import Inspection
    from grainmotion.planning.plan import Plan

WIDE_LOG, WIDEST_LOG = 160, 180  # columns of wide tables that go to no terminal
MAX_NAME_WIDTH = 24
"""Columns of the terminal that the name of a row gets at most in a table that is divided; longer ones are folded."""


def print_inspection(terminal: Terminal, inspection: Inspection) -> None:
    """Print the scans of an experiment, its volume and the memory that it needs."""
    from rich.markup import escape

    console = terminal.console(log_width=WIDE_LOG)
    names = ["scan", "radiographs", "type", "kind", "beam", "pixel at sample", "magnification", "air", "highest"]
    rows = [
        (
            escape(s.key),
            f"{s.views} x {s.rows} x {s.columns}",
            s.dtype,
            s.kind,
            s.beam,
            f"{s.pixel_at_sample:.4g} mm",
            f"{s.magnification:.4g}",
            f"{s.air:.4f}",
            f"{s.highest:.3g}",
            f"{s.pixels.bad} ({s.pixels.dead} dead, {s.pixels.dark} dark, {s.pixels.saturated} saturated)",
        )
        for s in inspection.scans
    ]
    print_within(console, [*names, "masked pixels"], rows)
    shape = " x ".join(str(n) for n in inspection.volume_shape)
    console.print(f"volume: {shape} voxels (z, y, x) of {inspection.voxel_size:.4g} mm")
    console.print(
        "lengths: an error of 1 % in the pixel size at the sample, by distances or pixel_size, is one of 1 % in all "
        "translations; no radiograph shows it"
    )
    console.print(f"memory: about {inspection.memory / 1e9:.2f} GB at the peak")


def print_within(console: Console, names: Sequence[str], rows: Sequence[Sequence[str]], *, keys: int = 1) -> None:
    """Print a table, as several ones below each other where it is wider than the console.

    Each of them begins with the first ``keys`` columns, which name a row.  Nothing is cut off: what does not fit into
    one column is folded.
    """
    from rich.table import Table

    def of(columns: Sequence[int], name_width: int | None = MAX_NAME_WIDTH) -> Table:
        table = Table()
        for k in columns:
            table.add_column(names[k], overflow="fold", max_width=name_width if k < keys else None)
        for row in rows:
            table.add_row(*(row[k] for k in columns))
        return table

    unlimited = console.options.update(width=100 * console.width)  # else a table is measured as it will be squeezed
    whole = of(range(len(names)), None)
    if console.measure(whole, options=unlimited).maximum <= console.width:
        console.print(whole)
        return
    named, rest = list(range(keys)), list(range(keys, len(names)))
    while rest:
        count = len(rest)
        while count > 1 and console.measure(of([*named, *rest[:count]]), options=unlimited).maximum > console.width:
            count -= 1
        console.print(of([*named, *rest[:count]]))
        rest = rest[count:]


def print_comparisons(terminal: Terminal, comparisons: dict[str, Comparison]) -> None:
    """Print the errors of each state against the truth, root mean square over grains and components."""
    from rich.markup import escape

    names = ["state", "grains", "failures", "translations", "rotations"]
    names += ["translation error (voxel)", "rotation error (deg)"]
    rows = []
    for name, c in comparisons.items():
        errors = f"{c.translation_rms_voxels:.4f}", f"{c.rotation_rms_deg:.4f}"
        good = str(int((~c.failed_translation).sum())), str(int((~c.failed_rotation).sum()))
        rows.append((escape(name), str(len(c)), str(c.failures), *good, *errors))
    print_within(terminal.console(), names, rows)


def print_plan(terminal: Terminal, plan: Plan) -> None:
    """Print each set of views: angles, predicted precision, and the motions to expect of tracking."""
    import numpy as np

    from grainmotion.planning.capture_range import CAPTURE_SOURCE

    names = ["views", "set", "angles (deg)", "sd of u (voxel)", "(mm)", "sd of w (deg)"]
    names += ["worst (voxel, deg)", "captured (diameters, deg)", "free across, along (mm)"]
    rows = [
        (
            str(len(s)),
            s.kind,
            str(row.angles_deg),
            f"{row.sd_u_voxel:.4f}",
            f"{row.sd_u_mm:.3g}",
            f"{row.sd_w_deg:.3f}",
            f"{row.worst_sd_u_voxel:.4f}, {row.worst_sd_w_deg:.3f}",
            "; ".join(f"{d:g}, {a:g}" for d, a in s.capture.ranges),
            f"{row.room_across_mm:.3g}, {row.room_along_mm:.3g}",
        )
        for s, row in zip(plan.sets, plan.angles_table().itertuples())
    ]
    print_within(terminal.console(log_width=WIDEST_LOG), names, rows, keys=2)
    exposure = f"{plan.settings.photons:.4g} photons a pixel of open beam, model error {plan.settings.model_error:g}"
    print(f"sd of a component: medians over {len(plan.labels)} grains; worst: of any grain; {exposure}")
    diameter = f"a diameter is {np.median(plan.diameters):.4g} mm"
    print(f"captured: largest random motions that converged from a zero start ({CAPTURE_SOURCE}); {diameter}")
    print("free: how far the sample may move across and along the axis before a footprint leaves the panel")
