"""Errors of measured motions against true ones, or differences of two measurements."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion.analysis.validation import Comparison
from grainmotion.plot.canvas import LINE_COLOURS, axes_of, legend_beside, note

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_TICKED_GRAINS = 40


@checked_arguments
def comparison(comparison: Comparison, *, rotation: bool = False, ax: Axes | None = None) -> Axes:
    """Errors of each grain by component, with their root mean square.

    Parameters
    ----------
    comparison : Comparison
        Of `compare`, with the truth or with another measurement.
    rotation : bool
        Errors of the rotations, degrees, in place of the translations.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        Translations in voxels where the comparison knows their size, else in mm.  Grains that failed are hollow, those
        without a measured one are missing.

    Examples
    --------
    >>> import grainmotion as gm
    >>> from dataclasses import replace
    >>> truth = gm.Motions.identity([1, 2, 3], [[0, 0, 0], [1, 0, 2], [2, 1, 1]])
    >>> found = replace(truth, translations=0.01 * truth.centers, statuses=["converged"] * 3)
    >>> ax = gm.plot.comparison(gm.compare(found, truth, voxel_size=0.1))
    """
    unit = comparison.voxel_size or 1.0
    errors = comparison.rotation_errors_deg if rotation else comparison.translation_errors / unit
    failed = comparison.failed_rotation if rotation else comparison.failed_translation
    rms = comparison.rotation_rms_deg if rotation else comparison.translation_rms / unit
    name = "°" if rotation else "voxel" if comparison.voxel_size else "mm"
    ax = axes_of(ax, (6.4, 3.8))
    places = np.arange(len(comparison))
    size = 4.0 if len(comparison) <= 10 * MAX_TICKED_GRAINS else 1.0
    if np.isfinite(rms):
        ax.axhspan(-rms, rms, color="0.9", zorder=0, label=f"rms {rms:.2g} {name}")
    ax.axhline(0, color="0.5", lw=0.8, zorder=1)
    for k, axis in enumerate("xyz"):
        shifted, colour = places + 0.22 * (k - 1), LINE_COLOURS[k]
        name_of_part = f"{'ω' if rotation else 'u'}{axis}"
        ax.plot(shifted[~failed], errors[~failed, k], "o", color=colour, ms=size, label=name_of_part)
        ax.plot(shifted[failed], errors[failed, k], "o", mfc="none", mec=colour, ms=size + 1)
    if len(comparison) <= MAX_TICKED_GRAINS:
        ax.set_xticks(places, [str(label) for label in comparison.labels], fontsize="small")
        ax.set_xlabel("grain")
    else:
        ax.set_xlabel("grain, by its row")
    ax.set_ylabel(f"error ({name})")
    ax.set_xlim(-0.6, len(comparison) - 0.4)
    legend_beside(ax)
    facts = [f"{failed.sum()} failed (hollow)" if failed.any() else ""]
    facts.append(f"{comparison.missing} without a measured one" if comparison.missing else "")
    note(ax, ", ".join(fact for fact in facts if fact))
    return ax
