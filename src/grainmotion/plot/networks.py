"""Contacts between grains as a network of lines between their centres."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.mechanics.contacts import Contacts
from grainmotion.model.grains import GrainSet
from grainmotion.model.motions import Motions
from grainmotion.plot.canvas import LINE_COLOURS, Plane, axes_of, frame_plane, legend_beside, note, plane_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KIND_STYLES = {
    "contact": (LINE_COLOURS[0], "-", 2.4),
    "indeterminate": (LINE_COLOURS[4], "--", 1.4),
    "overlap": (LINE_COLOURS[6], "-", 2.4),
    "open": ("0.75", ":", 1.2),
}
"""Colour, style and width of the line of each kind of pair."""


@checked_arguments
def contact_network(
    contacts: Contacts, grains: GrainSet | Motions, *, plane: Plane = "xz", ax: Axes | None = None
) -> Axes:
    """Pairs of grains that touch, as lines between their centres, and the places where they touch.

    Parameters
    ----------
    contacts : Contacts
        Of `grainmotion.contacts`.
    grains : GrainSet or Motions
        The grains for contacts in the reference; the motions of the state for contacts in that state.
    plane : {"xz", "yz", "xy"}
        The plane of the figure, the first to the right.
    ax : Axes, optional
        Where to draw; a new figure unless given.

    Returns
    -------
    Axes
        In mm of the sample frame; a colour for each kind of pair.

    Raises
    ------
    InputError
        If a pair names a grain that is not among the grains.

    Examples
    --------
    >>> import grainmotion as gm
    >>> import numpy as np
    >>> labels = np.zeros((12, 14, 24), int)
    >>> labels[3:9, 4:10, 3:10], labels[3:8, 3:10, 10:17] = 1, 2
    >>> grains = gm.grains_from_labels(gm.Volume(0.5 * (labels > 0), voxel_size=0.1), labels, finer=1)
    >>> ax = gm.plot.contact_network(gm.contacts(grains), grains)
    """
    from matplotlib.collections import LineCollection

    axes = plane_axes(plane)
    centers = grains.centers
    if isinstance(grains, Motions):
        centers = centers + np.nan_to_num(grains.translations)
    ends = _ends(contacts, grains.labels.tolist(), centers)[..., axes]
    ax = axes_of(ax)
    for kind, (colour, style, width) in KIND_STYLES.items():
        rows = contacts.kinds == kind
        if rows.any():
            name = f"{rows.sum()} {kind}"
            ax.add_collection(LineCollection(list(ends[rows]), colors=colour, linestyles=style, lw=width, label=name))
    touching = contacts.touching
    places = "place of a contact" if touching.any() else None
    ax.plot(
        *contacts.points[touching][:, axes].T, "D", color="white", mec=LINE_COLOURS[0], ms=4, zorder=4, label=places
    )
    ax.plot(*centers[:, axes].T, "o", color="0.3", ms=6, zorder=3)
    frame_plane(ax, plane, centers[:, axes])
    legend_beside(ax)
    note(ax, f"{len(contacts.left_out)} grains left out" if contacts.left_out else "")
    return ax


def _ends(contacts: Contacts, labels: list[int], centers: Float) -> Float:
    """Centres of the two grains of each pair ``(m, 2, 3)``, mm."""
    rows = {label: row for row, label in enumerate(labels)}
    missing = sorted(set(contacts.pairs.ravel().tolist()) - set(rows))
    if missing:
        raise InputError("grains", f"there is no grain {missing[0]}", "give the grains of these contacts")
    pairs = np.array([[rows[int(label)] for label in pair] for pair in contacts.pairs], dtype=np.int64)
    return np.asarray(centers[pairs.reshape(-1, 2)], dtype=float)
