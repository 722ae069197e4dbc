"""The terminal: progress and tables.

On a terminal progress is a bar on standard error; otherwise it is a log, line by line on standard output,
so that standard error holds errors alone.  Findings are shown as they come, above the bar or as lines of the log.
"""

from __future__ import annotations

import re
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from grainmotion.cli import findings
from grainmotion.model.finding import worst_first

if TYPE_CHECKING:
    from grainmotion._typing import Progress
    from grainmotion.analysis.validation import Comparison
    from grainmotion.experiment.inspection import Inspection
    from grainmotion.model.motions import Motions
    from grainmotion.planning.plan import Plan
    from grainmotion.workflow.run import RunResult

MAX_REASONS, MAX_LABELS = 20, 10  # reasons that are printed, and grains of each; the report has all
Say = Callable[[str], None]


@contextmanager
def progress(quiet: bool) -> Iterator[Progress]:
    """A listener for ``progress``: a bar on a terminal, one line a step in a log, nothing but warnings if quiet.

    It also makes Ctrl-C and SIGTERM end the work: an exception that is raised inside the callback of a compiler or
    library can be lost, so it is raised again at the next report of progress.
    """
    stopped = threading.Event()

    def stop(_signal: int, _frame: object) -> None:
        stopped.set()
        raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    show = _silence if quiet else _bar if sys.stderr.isatty() else _log
    try:
        with contextmanager(show)() as (listen, say), findings.shown(say, quiet=quiet):

            def listen_or_stop(message: str, done: int, total: int) -> None:
                if stopped.is_set():
                    raise KeyboardInterrupt
                listen(message, done, total)

            yield listen_or_stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _silence() -> Iterator[tuple[Progress, Say]]:
    yield (lambda _message, _done, _total: None), findings.print_message


def _bar() -> Iterator[tuple[Progress, Say]]:
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)

        def listen(message: str, done: int, total: int) -> None:
            bar.update(task, description=message, completed=done, total=total)

        def say(message: str) -> None:  # rich draws the bar again below
            bar.console.print(findings.styled(message, bar.console.width))

        yield listen, say


def _log() -> Iterator[tuple[Progress, Say]]:
    """Print the last message of each step, which carries its outcome."""
    last = [""]

    def step(message: str) -> str:
        return re.split(r", ε|: residual", message)[0]

    def listen(message: str, done: int, total: int) -> None:
        if last[0] and step(message) != step(last[0]):
            print(last[0], flush=True)
        last[0] = message

    try:
        yield listen, findings.print_message
    finally:
        if last[0]:
            print(last[0], flush=True)


def print_stages(result: RunResult, quiet: bool) -> None:
    """Print which stages a run did, and which it kept from an earlier run."""
    if not quiet:
        print(f"done: {', '.join(result.done) or 'nothing'}; kept: {', '.join(result.reused) or 'nothing'}")


def print_inspection(inspection: Inspection) -> None:
    """Print the result of `inspect_inputs`."""
    console = Console(width=None if sys.stdout.isatty() else 160)
    table = Table("scan", "radiographs", "type", "kind", "beam", "pixel at sample", "magnification", "air", "highest")
    table.add_column("masked pixels")
    for s in inspection.scans:
        table.add_row(
            s.key,
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
    console.print(table)
    shape = " x ".join(str(n) for n in inspection.volume_shape)
    console.print(f"volume: {shape} voxels (z, y, x) of {inspection.voxel_size:.4g} mm")
    console.print(
        "lengths: an error of 1 % in the pixel size at the sample, by distances or pixel_size, is one of 1 % in all "
        "translations; no radiograph shows it"
    )
    console.print(f"memory: about {inspection.memory / 1e9:.2f} GB at the peak")
    findings.print_findings(worst_first(inspection.findings))


def print_facts(title: str, facts: Sequence[tuple[str, str]]) -> None:
    """Print label and text of each fact, one a line, under a title."""
    print(title)
    width = max((len(label) for label, _ in facts), default=0)
    for label, text in facts:
        print(f"  {label:<{width}}  {text}")


def print_reference(sentences: Sequence[str]) -> None:
    """Print what attenuates in the reference of the last run; nothing if there is none yet."""
    if sentences:
        print("reference of the last run, with shares of its attenuation:")
    for sentence in sentences:
        print(f"  {sentence}")


def print_states(motions: dict[str, Motions]) -> None:
    """Print how the tracking of each state went: grains, translations and rotations to use, and why others are not."""
    import numpy as np

    from grainmotion.diagnosis.results import SEE_COMMON_CAUSE
    from grainmotion.report.tables import scene_sentences

    if not motions:
        return
    names = "state", "grains", "converged", "translations", "rotations", "others", "median |u| (mm)", "median |w| (deg)"
    table = Table(*names)
    for name, m in motions.items():
        statuses, counts = np.unique(m.statuses[~m.ok], return_counts=True)
        others = ", ".join(f"{n} {status}" for status, n in zip(statuses, counts))
        u = np.linalg.norm(m.translations[m.ok_translation], axis=1)
        w = np.rad2deg(np.linalg.norm(m.rotations[m.ok_rotation], axis=1))
        medians = [f"{np.median(v):.4g}" if len(v) else "-" for v in (u, w)]
        table.add_row(
            escape(name), str(len(m)), str(int(m.ok.sum())), str(len(u)), str(len(w)), others or "-", *medians
        )
    Console(width=None if sys.stdout.isatty() else 120).print(table)
    for name, m in motions.items():
        for sentence in scene_sentences(m.fit):
            print(f"{name}: {sentence}")
    groups: dict[tuple[str, str], list[int]] = {}
    for name, m in motions.items():
        for label, status, reason, ok in zip(m.labels, m.statuses, m.reasons, m.ok):
            if not ok and not reason.startswith(SEE_COMMON_CAUSE):  # that one is a finding
                groups.setdefault((name, reason or str(status)), []).append(int(label))
    for (name, reason), labels in list(groups.items())[:MAX_REASONS]:
        more = f" and {len(labels) - MAX_LABELS} more" if len(labels) > MAX_LABELS else ""
        which = f"grain{'s' * (len(labels) > 1)} {', '.join(map(str, labels[:MAX_LABELS]))}{more}"
        findings.print_message(f"{name}, {which}: {reason}")
    if len(groups) > MAX_REASONS:
        print(f"... and {len(groups) - MAX_REASONS} more reasons, in the report")


def print_comparisons(comparisons: dict[str, Comparison]) -> None:
    """Print the errors of each state against the truth, root mean square over grains and components."""
    table = Table("state", "grains", "failures", "translations", "rotations")
    table.add_column("translation error (voxel)")
    table.add_column("rotation error (deg)")
    for name, c in comparisons.items():
        errors = f"{c.translation_rms_voxels:.4f}", f"{c.rotation_rms_deg:.4f}"
        good = str(int((~c.failed_translation).sum())), str(int((~c.failed_rotation).sum()))
        table.add_row(escape(name), str(len(c)), str(c.failures), *good, *errors)
    Console(width=None if sys.stdout.isatty() else 120).print(table)


def print_plan(plan: Plan) -> None:
    """Print each set of views: angles, predicted precision, and the motions to expect of tracking."""
    import numpy as np

    from grainmotion.planning.capture_range import CAPTURE_SOURCE

    console = Console(width=None if sys.stdout.isatty() else 180)
    table = Table("views", "set", "angles (deg)", "sd of u (voxel)", "(mm)", "sd of w (deg)")
    for name in ("worst (voxel, deg)", "captured (diameters, deg)", "free across, along (mm)"):
        table.add_column(name)
    for s, row in zip(plan.sets, plan.angles_table().itertuples()):
        table.add_row(
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
    console.print(table)
    exposure = f"{plan.settings.photons:.4g} photons a pixel of open beam, model error {plan.settings.model_error:g}"
    print(f"sd of a component: medians over {len(plan.labels)} grains; worst: of any grain; {exposure}")
    diameter = f"a diameter is {np.median(plan.diameters):.4g} mm"
    print(f"captured: largest random motions that converged from a zero start ({CAPTURE_SOURCE}); {diameter}")
    print("free: how far the sample may move across and along the axis before a footprint leaves the panel")
