"""Hypotheses about the geometry of a later state, to be compared with the reference (`state_geometry`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.optimize import linear_sum_assignment

from grainmotion._typing import Float, Image
from grainmotion.diagnosis.coarse_likeness import Fit, Likeness
from grainmotion.diagnosis.hypotheses import EQUAL_STEPS, HYPOTHESES, corrected, stage_angles_deg, turned
from grainmotion.model.geometry import Geometry

IMAGE_CHANGES: Mapping[str, Callable[[Image], Image]] = MappingProxyType({
    "rows-flipped": lambda images: images[:, ::-1],
    "columns-flipped": lambda images: images[:, :, ::-1],
    "half-turned": lambda images: images[:, ::-1, ::-1],
    "transposed": lambda images: images.transpose(0, 2, 1),
    "quarter-turned": lambda images: images.transpose(0, 2, 1)[:, :, ::-1],
    "quarter-turned-back": lambda images: images.transpose(0, 2, 1)[:, ::-1],
})  # fmt: skip
"""Hypotheses about the panel, as changes of the radiographs, so that no other view need be simulated."""
COMBINED_WITH = ("rows-flipped", "columns-flipped")
"""Hypotheses about the panel that are tried together with each about the angles."""
NEGATED = "angles-negated"
COMBINED_WITH_SIGN = (
    "angles-in-radians", "half-the-span", "twice-the-span", "start-at-90", "start-at-180", "start-at-270",
)  # fmt: skip
"""Hypotheses about the angles that are tried together with the wrong sign."""
OPPOSITE_STARTS = MappingProxyType({"start-at-90": "start-at-270", "start-at-180": "", "start-at-270": "start-at-90"})
"""Starts from behind; none is the start as given."""
ANGLE_STEP_DEG = 5.0
"""Step of the angles at which a view may have been taken."""
SAME_ANGLE_DEG = 4.0
"""Hypotheses whose views differ by less are one; in a cone of a few degrees, a view from behind is a flipped one."""
PIXEL_SCALES = (0.5, 0.8, 0.9, 1.1, 1.25, 2.0)
"""Factors of the pixel size that are tried."""


@dataclass(frozen=True, eq=False)
class Candidate:
    """A hypothesis about the state's geometry, or several at once.

    ``fixes`` are the names that undo it, together; none if it has no name.  ``text`` says what would be wrong, and
    ``panel`` what is done to the radiographs.  ``remedy`` is what to do where no name undoes it.
    """

    fixes: tuple[str, ...]
    text: str
    images: Image
    geometry: Geometry
    panel: str = ""
    remedy: str = ""

    def fit(self, likeness: Likeness) -> Fit:
        """Its likeness."""
        return likeness.fit(self.images, self.geometry)


def as_given(likeness: Likeness) -> Candidate:
    """The geometry as given."""
    return Candidate((), "", likeness.measured, likeness.geometry)


def single_mistakes(likeness: Likeness) -> list[Candidate]:
    """One usual mistake each; those that change nothing are left out."""
    geometry, images = likeness.geometry, likeness.measured
    found = []
    for name, hypothesis in HYPOTHESES.items():
        if name in IMAGE_CHANGES:
            changed = IMAGE_CHANGES[name](images)
            if likeness.fits_window(changed.shape):
                found.append(Candidate((name,), hypothesis.mistake, changed, geometry, name))
        elif name != EQUAL_STEPS:  # the few views of a state are often spaced unequally
            found.append(Candidate((name,), hypothesis.mistake, images, hypothesis.change(geometry)))
    return [c for c in found if not alike(c, as_given(likeness))]


def double_mistakes(likeness: Likeness) -> list[Candidate]:
    """Mistakes in the angles with images flipped or a wrong sign, where that is not one mistake in disguise."""
    singles = single_mistakes(likeness)
    found = list[Candidate]()
    for c in (c for c in singles if not c.panel):
        for panel in COMBINED_WITH:
            text = f"{c.text}, and {HYPOTHESES[panel].mistake}"
            images = IMAGE_CHANGES[panel](likeness.measured)
            found.append(Candidate((*c.fixes, panel), text, images, c.geometry, panel))
        if c.fixes != (NEGATED,) and c.fixes[0] in COMBINED_WITH_SIGN:
            names, text = (NEGATED, *c.fixes), f"{HYPOTHESES[NEGATED].mistake}, and {c.text}"
            found.append(Candidate(names, text, c.images, corrected(likeness.geometry, names)))
    known = [as_given(likeness), *singles]
    for c in found:
        if not any(alike(c, other) for other in known):
            known.append(c)
    return known[1 + len(singles) :]


def twin(candidate: Candidate) -> tuple[str, ...]:
    """Fixes that do the same in a parallel beam, where a view of flipped columns is one from behind; none if alike."""
    starts = [name for name in candidate.fixes if name in OPPOSITE_STARTS]
    flipped = "columns-flipped" in candidate.fixes
    if not starts and not flipped:
        return ()
    opposite = OPPOSITE_STARTS[starts[0]] if starts else "start-at-180"
    others = [name for name in candidate.fixes if name not in (*starts, "columns-flipped")]
    return tuple(name for name in (*others, opposite, "" if flipped else "columns-flipped") if name)


def alike(a: Candidate, b: Candidate) -> bool:
    """Whether two hypotheses describe the same radiographs, in a parallel beam at least."""
    (panel_a, angles_a), (panel_b, angles_b) = _kind(a), _kind(b)
    gaps = (angles_a - angles_b + 180) % 360 - 180
    return panel_a == panel_b and bool((np.abs(gaps) < SAME_ANGLE_DEG).all())


def _kind(candidate: Candidate) -> tuple[str, Float]:
    """What is done to the rows, and the angles: columns that run the other way are a view from behind."""
    panel = candidate.panel
    from_behind = panel in ("columns-flipped", "half-turned")
    kinds = {"columns-flipped": "", "half-turned": "rows-flipped"}
    sizes = np.linalg.norm(candidate.geometry.u[0]) * 1e3  # other distances or pixels are another hypothesis
    angles = stage_angles_deg(candidate.geometry) + 180 * from_behind
    return f"{kinds.get(panel, panel)} {sizes:.3g}", angles


def gain(before: Fit | Float | float, after: Fit | Float | float) -> float:
    """Logarithm of the unexplained share before over that after."""
    x, y = (np.clip(f.mean if isinstance(f, Fit) else f, 0.0, 0.999) for f in (before, after))
    return float(np.log((1 - x**2) / (1 - y**2)))


@dataclass(frozen=True, eq=False)
class Sweep:
    """Likeness of each radiograph to views all around, each with a shift of its own ``(views, angles)``."""

    angles_deg: Float
    upright: Float  # as given
    flipped: Float  # with rows the other way

    @classmethod
    def of(cls, likeness: Likeness) -> Sweep:
        """The likeness at all angles."""
        angles = np.arange(0.0, 360.0, ANGLE_STEP_DEG)
        now = stage_angles_deg(likeness.geometry)
        tables = []
        for change in (lambda images: images, IMAGE_CHANGES["rows-flipped"]):
            rows = []
            for k, image in enumerate(change(likeness.measured)):
                view = likeness.geometry[[k] * len(angles)]
                rows.append(
                    likeness.best(np.broadcast_to(image, (len(angles), *image.shape)), turned(view, angles - now[k]))
                )
            tables.append(np.array(rows))
        return cls(angles, *tables)

    def at(self, angles_deg: Float, *, flipped: bool = False) -> Float:
        """Likeness of each radiograph at each of the angles ``(views, angles)``."""
        table = self.flipped if flipped else self.upright
        return np.stack(
            [np.interp(angles_deg % 360, np.append(self.angles_deg, 360), np.append(row, row[0])) for row in table]
        )


def other_starts(likeness: Likeness, sweep: Sweep) -> list[Candidate]:
    """The best start angle, for each sense of rotation, rows upright or flipped."""
    now = stage_angles_deg(likeness.geometry)
    found = []
    for sense in (1, -1):
        for panel in ("", "rows-flipped"):
            scores = []
            for start in sweep.angles_deg:
                table = sweep.at(sense * now + start, flipped=bool(panel))
                scores.append(np.diagonal(table).mean())
            start = float(sweep.angles_deg[int(np.argmax(scores))])
            geometry = turned(likeness.geometry, sense * now + start - now)
            images = IMAGE_CHANGES[panel](likeness.measured) if panel else likeness.measured
            shift = (start + 180) % 360 - 180
            text = f"the angles start {abs(shift):g} degrees {'later' if shift > 0 else 'earlier'}"
            text += ", and have the wrong sign" if sense < 0 else ""
            text += f", and {HYPOTHESES[panel].mistake}" if panel else ""
            found.append(Candidate((), text, images, geometry, panel))
    return [c for c in found if not alike(c, as_given(likeness))]


def other_order(likeness: Likeness, sweep: Sweep) -> list[Candidate]:
    """The radiographs in the order that suits the angles given best, or those of the other sign."""
    now, found = stage_angles_deg(likeness.geometry), []
    for sense in (1, -1):
        table = sweep.at(sense * now)
        order = linear_sum_assignment(-np.log(1 / np.maximum(1 - table**2, 1e-3)))[1]
        angles = ", ".join(f"{sense * now[k] + 0.0:g}" for k in order)
        text = "the radiographs are in another order"
        text += "" if sense > 0 else ", and the angles have the wrong sign"
        text += f": in their order, the angles are {angles} degrees"
        geometry = turned(likeness.geometry, sense * now - now)[order]
        found.append(Candidate((), text, likeness.measured, geometry))
    return [c for c in found if not alike(c, as_given(likeness))]


def other_scales(likeness: Likeness) -> list[Candidate]:
    """Radiographs of larger or smaller pixels, or of another magnification."""
    found = []
    for scale in PIXEL_SCALES:
        vectors = likeness.geometry.vectors.copy()
        vectors[:, 6:] *= scale
        geometry = Geometry(vectors, likeness.geometry.shape, likeness.geometry.beam)
        text = f"the pixels are {scale:g} times as large at the sample: another binning or magnification"
        remedy = f"multiply pixel_size by {scale:g} in the state's geometry, or correct its distances"
        found.append(Candidate((), text, likeness.measured, geometry, remedy=remedy))
    return found
