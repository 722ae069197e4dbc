"""§4.2, Eqs. 23 and 24: the reconstruction's residual ε against SART sweeps, and the noise at which it settles."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from grainmotion.model.scan import snr
from grainmotion.projection.volumes import project
from validation.common.cache import RECONSTRUCTION
from validation.paper import gravel, page

SWEEPS = 6
SCANS = {"A": 0, "B": 1}
SETTLED_CHANGE = 0.02  # of ε: a sweep that changes it by less no longer matters


def study() -> page.Section:
    """Two scans of one state, each reconstructed and each projected against both."""
    noise = 1 / snr(*(gravel.full_scan(number) for number in SCANS.values()))
    before = {name: gravel.sweep(SWEEPS, noise=number).residuals for name, number in SCANS.items()}
    after = {name: np.array([epsilons(name, count) for count in range(1, SWEEPS + 1)]) for name in SCANS}
    siddon = gravel.reference(gravel.SIDDON).residuals
    caption = (
        "ε against SART sweeps, from the empty volume on and near the noise level 1/SNR, for two scans of one state "
        "that differ in their noise: a reconstruction against the other scan, each view just before its update, and "
        "against its own scan."
    )
    parts = [
        _intro(noise),
        page.figure("reconstruction", _draw(before, after, noise), caption),
        _table(before, after, siddon, noise),
        _findings(before, after, siddon, noise),
    ]
    return page.Section("§4.2: residual of the reconstruction against sweeps", "\n\n".join(parts))


@page.PAGE.cached(*RECONSTRUCTION)
def epsilons(name: str, count: int) -> NDArray[np.float64]:
    """ε = ‖b − A x‖/‖b‖ of a scan's reconstruction after some sweeps: against itself, and against the other."""
    scans = [gravel.full_scan(SCANS[name]), *(gravel.full_scan(n) for k, n in SCANS.items() if k != name)]
    volume = gravel.sweep(count, noise=SCANS[name]).volume
    images = project(volume, scans[0].geometry, projector=gravel.SMOOTH.projector)
    return np.array([_norm(scan.line_integrals - images) / _norm(scan.line_integrals) for scan in scans])


def _norm(images: NDArray[np.floating]) -> float:
    return float(np.sqrt(np.sum(np.square(images, dtype=np.float64))))


def _intro(noise: float) -> str:
    case = gravel.case()
    return (
        f"Two full scans of the gravel at rest, {case.scanner.reference_views} views each, differ in their noise "
        f"alone.  From their difference, Eq. 24 gives SNR = {1 / noise:.1f}, a relative noise of {noise:.4f}.  Each is "
        f"reconstructed by SART with the smooth projector; Eq. 23 is ε = ‖b − A x‖/‖b‖.\n\n"
        "There are three ways to take ε.  *Before*: each view just before its own update, gathered over the sweep "
        "while the volume changes; it is what `Reconstruction.residuals` holds and what the stopping rule reads, as "
        "it costs nothing.  *Own*: the volume after the sweep, projected and compared with the scan that made it.  "
        "*Other*: the same volume compared with the other scan, which has other noise."
    )


def _draw(before: dict[str, tuple[float, ...]], after: dict[str, NDArray[np.float64]], noise: float) -> Figure:
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    sweeps = np.arange(SWEEPS + 1)
    for axes in figure.subplots(1, 2):
        for name, line, marker in (("A", "-", "o"), ("B", "", "x")):
            curves = {"other": after[name][:, 1], "before its update": before[name], "own": after[name][:, 0]}
            for (kind, values), colour in zip(curves.items(), ("tab:red", "tab:gray", "tab:blue"), strict=True):
                style = {"color": colour, "linestyle": line, "marker": marker, "ms": 5, "mfc": "none"}
                axes.plot(sweeps, [1, *values], label=f"scan {name}, {kind}", **style)
        axes.axhline(noise, color="black", lw=1, label=f"1/SNR = {noise:.4f}")
        axes.set_xticks(sweeps)
        axes.set(xlabel="SART sweeps", ylabel="ε")
        axes.set_yscale("log")
    axes.legend(fontsize=8)
    axes.set_yscale("linear")
    axes.set(xlim=(0.8, SWEEPS + 0.2), ylim=(0.97 * noise, 1.03 * max(found[0, 1] for found in after.values())))
    return figure


def _table(
    before: dict[str, tuple[float, ...]],
    after: dict[str, NDArray[np.float64]],
    siddon: tuple[float, ...],
    noise: float,
) -> str:
    head = ["sweep"]
    for name in SCANS:
        head += [f"{name}, before", f"{name}, own", f"{name}, other"]
    head += ["A, other, over 1/SNR", "A by Siddon, before"]
    rows = []
    for k in range(SWEEPS):
        row = [str(k + 1)]
        for name in SCANS:
            row += [f"{before[name][k]:.4f}", f"{after[name][k, 0]:.4f}", f"{after[name][k, 1]:.4f}"]
        row += [f"{after['A'][k, 1] / noise:.3f}", f"{siddon[k]:.4f}" if k < len(siddon) else "–"]
        rows.append(row)
    return page.table(head, rows)


def _findings(
    before: dict[str, tuple[float, ...]],
    after: dict[str, NDArray[np.float64]],
    siddon: tuple[float, ...],
    noise: float,
) -> str:
    own, other = after["A"].T
    settled = next((k for k, (a, b) in enumerate(pairwise(other), start=2) if abs(b / a - 1) < SETTLED_CHANGE), None)
    best = int(np.argmin(other))
    taken = len(gravel.reference().residuals)
    when = (
        f"changes by less than {SETTLED_CHANGE:.0%} a sweep from sweep {settled} on" if settled else "does not settle"
    )
    beyond = np.sqrt(max(other[best] ** 2 - noise**2, 0))
    fitted = (other[-1] ** 2 - own[-1] ** 2) / 2 / noise**2
    apart = np.abs(after["A"][-1] / after["B"][-1] - 1).max()
    return (
        f"Against the other scan, ε of A's reconstruction {when}, and is least after sweep {best + 1}: "
        f"{other[best]:.4f}, which is {other[best] / noise:.3f} of the noise.  What it has beyond the noise, "
        f"{beyond:.4f} of ‖b‖ as the root of the difference of the squares, is the voxels' blur of surfaces and the "
        f"noise of scan A that the volume carries.  Against its own scan ε is lower, {own[-1]:.4f} after sweep "
        f"{SWEEPS}, as the volume has fitted {fitted:.1%} of that scan's noise (half of the difference of the squares, "
        "over the noise's): of the three, *own* flatters most, *other* is the honest one.  After the last sweep the "
        f"two scans agree in ε to {apart:.2%}.  The package's own rule reads *before* and stops after sweep {taken}, "
        f"at {before['A'][taken - 1]:.4f}, where *other* is {other[taken - 1]:.4f}.  With Siddon's path in place of "
        f"the smooth projector, *before* ends at {siddon[-1]:.4f} after {len(siddon)} sweeps."
    )
