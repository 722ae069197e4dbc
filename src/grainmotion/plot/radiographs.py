"""Radiographs of a state: as measured, as simulated from the motions, and what is left between them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float, Image
from grainmotion.analysis.residual_images import check_views, residual_images
from grainmotion.errors import InputError
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.plot.canvas import DIVERGING, GREYS, LINE_COLOURS, TEXT_SIZE, axes_of, colour_bar

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHARE_OF_CLIPPED_PIXELS = 0.002
FIGURE_SIZE = (5.6, 4.6)


@checked_arguments
def radiograph(scan: Scan, view: int = 0, *, points: Float | None = None, ax: Axes | None = None) -> Axes:
    """One radiograph, drawn with +z upwards.

    Parameters
    ----------
    scan : Scan
        Line integrals with their geometry.
    view : int
        Which view; negative ones count from the last.
    points : (m, 3) array, optional
        Points of the sample, mm, such as ``motions.centers + motions.translations``, marked where they are seen.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In columns and rows.  Masked pixels are blank.

    Raises
    ------
    InputError
        If there is no such view.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> views = gm.Geometry.parallel([0, 90], (30, 40), 0.1)
    >>> ball = gm.Volume(np.pad(np.ones((8, 8, 8)), 4), voxel_size=0.1)
    >>> scan = gm.Scan(gm.project(ball, views), views)
    >>> ax = gm.plot.radiograph(scan, view=1, points=np.zeros((1, 3)))
    """
    view = _checked(scan, view)
    image = scan.line_integrals[view].astype(float)
    if scan.valid is not None:
        image = np.where(scan.valid[view], image, np.nan)
    ax = _draw(ax, image, scan, view, "line integral", diverging=False)
    if points is not None:
        points = np.asarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != 3:
            raise InputError("points", f"shape {points.shape}", "give (m, 3): x, y, z of each point, mm")
        seen = scan.geometry[view].project_points(points)[0]
        ax.plot(seen[:, 1], seen[:, 0], "o", mfc="none", mec=LINE_COLOURS[1], ms=5, mew=1.2, scalex=False, scaley=False)
    return ax


@checked_arguments
def simulated(grains: GrainSet, motions: Motions, scan: Scan, view: int = 0, *, ax: Axes | None = None) -> Axes:
    """What the motions of a state make of one radiograph, with the gain and offset of its fit.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference.
    motions : Motions
        Of the state; grains without a motion are left out.
    scan : Scan
        Radiographs of the state, as they were given to `track`.
    view : int
        Which view.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In columns and rows, with the greys that `radiograph` would choose for the simulated image.

    Raises
    ------
    InputError
        If there is no such view, or the motions were fitted to another number of views.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> labels = np.pad(np.ones((8, 8, 8), int), 4)
    >>> grains = gm.grains_from_labels(gm.Volume(0.5 * labels, voxel_size=0.1), labels)
    >>> unmoved = gm.Motions.identity(grains.labels, grains.centers)
    >>> views = gm.Geometry.parallel([0, 90], (30, 40), 0.1)
    >>> scan = gm.Scan(gm.simulate_radiographs(grains, unmoved, views), views)
    >>> ax = gm.plot.simulated(grains, unmoved, scan, view=1)
    """
    view = _checked(scan, view)
    measured = grains.scene.hardening.apply(scan).line_integrals[view]
    image = measured - _residual(grains, motions, scan, view)
    return _draw(ax, image, scan, view, "simulated line integral", diverging=False)


@checked_arguments
def residual(grains: GrainSet, motions: Motions, scan: Scan, view: int = 0, *, ax: Axes | None = None) -> Axes:
    """Measured minus simulated line integrals of one view: where a shadow is red, something is missing in the model.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference.
    motions : Motions
        Of the state; grains without a motion are left out of what is simulated.
    scan : Scan
        Radiographs of the state, as they were given to `track`.
    view : int
        Which view.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In columns and rows; the title tells the root mean square.

    Raises
    ------
    InputError
        If there is no such view, or the motions were fitted to another number of views.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> labels = np.pad(np.ones((8, 8, 8), int), 4)
    >>> grains = gm.grains_from_labels(gm.Volume(0.5 * labels, voxel_size=0.1), labels)
    >>> unmoved = gm.Motions.identity(grains.labels, grains.centers)
    >>> views = gm.Geometry.parallel([0, 90], (30, 40), 0.1)
    >>> scan = gm.Scan(gm.simulate_radiographs(grains, unmoved, views) + 0.01, views)
    >>> ax = gm.plot.residual(grains, unmoved, scan)
    """
    view = _checked(scan, view)
    image = _residual(grains, motions, scan, view)
    ax = _draw(ax, image, scan, view, "measured − simulated", diverging=True)
    ax.set_title(f"{ax.get_title()}, rms {np.sqrt(np.nanmean(image**2)):.2g}")
    return ax


def _checked(scan: Scan, view: int) -> int:
    """The number of a view, from 0."""
    if not -len(scan) <= view < len(scan):
        raise InputError("view", f"there is no view {view}", f"give 0 to {len(scan) - 1}")
    return view % len(scan)


def _residual(grains: GrainSet, motions: Motions, scan: Scan, view: int) -> Image:
    """Measured − simulated of one view; other views are not simulated."""
    check_views(motions.fit, scan)
    one = replace(motions, fit=motions.fit.of_views([view]))
    return residual_images(grains, one, scan.select([view]))[0]


def _draw(ax: Axes | None, image: Image, scan: Scan, view: int, label: str, *, diverging: bool) -> Axes:
    """An image of one view with +z upwards, its scale and its angle."""
    ax = axes_of(ax, FIGURE_SIZE)
    low, high = _limits(image, diverging=diverging)
    upright = float(scan.geometry.v[view, 2]) >= 0
    cmap = DIVERGING if diverging else GREYS
    drawn = ax.imshow(image, cmap=cmap, vmin=low, vmax=high, origin="lower" if upright else "upper")
    colour_bar(ax, drawn, label)
    ax.set_xlabel("column")
    ax.set_ylabel("row")
    ax.set_title(f"view {view}, {scan.geometry[view].azimuths_deg[0]:.4g}°")
    colour = LINE_COLOURS[0] if diverging else "white"
    ax.annotate(
        "z", (0.06, 0.97), (0.06, 0.82), "axes fraction", arrowprops={"arrowstyle": "->", "color": colour}, ha="center",
        va="center", color=colour, fontsize=TEXT_SIZE,
    )  # fmt: skip
    return ax


def _limits(image: Image, *, diverging: bool) -> tuple[float, float]:
    """Limits of the colours that clip few pixels; symmetric about 0 where they diverge."""
    values = image[np.isfinite(image)]
    if values.size == 0:
        return (-1.0, 1.0) if diverging else (0.0, 1.0)
    if diverging:
        limit = float(np.quantile(np.abs(values), 1 - SHARE_OF_CLIPPED_PIXELS)) or 1.0
        return -limit, limit
    low, high = (float(q) for q in np.quantile(values, [SHARE_OF_CLIPPED_PIXELS / 2, 1 - SHARE_OF_CLIPPED_PIXELS / 2]))
    low = 0.0 if 0 < low < 0.5 * high else low
    return low, high if high > low else low + 1.0
