"""Plan: the design of an experiment before beam time, from the grains of a reference volume.

For candidate views around the sample: the precision to expect of each grain's motion from 2, 3, 4, 6 of them, the
angles that are best, and the motions that tracking can be expected to capture.  Precision is the bound that
photon noise sets (Cramér and Rao) for the voxel images of the grains in their reference state, with a model error
beside it; see `planning.fisher_information` and `planning.view_selection`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from grainmotion._arguments import checked_arguments, renamed_arguments
from grainmotion._typing import Float, Progress
from grainmotion.errors import InputError
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.summary import Summarised, Summary
from grainmotion.planning.candidates import even_set
from grainmotion.planning.capture_range import Capture, expected_capture, room
from grainmotion.planning.fisher_information import Candidates
from grainmotion.planning.settings import PlanSettings
from grainmotion.planning.view_selection import ViewSelector

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Plan", "PlanSettings", "ViewSet", "plan"]

PLAN_COLUMNS = (
    "label", "x", "y", "z", "views", "set", "sd_ux", "sd_uy", "sd_uz", "sd_wx", "sd_wy", "sd_wz",
)  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class ViewSet(Summarised):
    """A set of views, and the precision and capture range to expect from it.

    Attributes
    ----------
    kind : str
        "best", or "even": spread evenly over 180° from the first candidate on.
    indices : tuple of int
        Candidates of the set.
    angles_deg : (k,) array
        Their angles.
    covariances : (n, 6, 6) array
        Of (u, δ) of each grain, mm and radians.
    surface_sd : (n,) array
        Predicted sd of each grain's surface per component, mm.
    room : (2,) array
        How far the sample may move across and along the axis before a projection leaves the detector, mm.
    capture : Capture
        The capture range that was measured with as many views.
    """

    kind: str
    indices: tuple[int, ...]
    angles_deg: Float
    covariances: Float
    surface_sd: Float
    room: Float
    capture: Capture

    def __len__(self) -> int:
        return len(self.indices)

    @property
    def sd(self) -> Float:
        """Standard deviations ``(n, 6)`` of u (mm) and δ (radians)."""
        return np.sqrt(np.einsum("nkk->nk", self.covariances))

    @property
    def criterion(self) -> float:
        """Geometric mean of ``surface_sd``, mm: the criterion of the choice."""
        return float(np.exp(np.mean(np.log(self.surface_sd))))

    @property
    def sd_translation(self) -> Float:
        """Root mean square of the components' sd, ``(n,)``, mm."""
        return np.asarray(np.sqrt(np.mean(self.sd[:, :3] ** 2, axis=1)))

    @property
    def sd_rotation_deg(self) -> Float:
        """Root mean square of the components' sd, ``(n,)``, degrees."""
        return np.asarray(np.rad2deg(np.sqrt(np.mean(self.sd[:, 3:] ** 2, axis=1))))


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Summarised):
    """Result of `plan`.

    Attributes
    ----------
    labels : (n,) int array
    centers : (n, 3) array
        mm, x y z.
    diameters : (n,) array
        Of balls with the grains' moments of inertia, mm.
    voxel_size : float
        mm.
    geometry : Geometry
        The candidate views.
    angles_deg : (m,) array
        Their angles.
    sets : tuple of ViewSet
        By number of views, the best set before the even one.
    pairs : (m, m) array
        The criterion of all pairs of candidates, mm.
    coupled : bool
        Whether neighbours were free too while angles were chosen; covariances always hold the coupling.
    settings : PlanSettings

    Examples
    --------
    >>> plan = gm.plan(grains, case.scanner.geometry((0, 45, 90, 135)), gm.PlanSettings(views=(2,)))
    >>> len(plan.sets) > 0
    True
    """

    labels: NDArray[np.int64]
    centers: Float
    diameters: Float
    voxel_size: float
    geometry: Geometry
    angles_deg: Float
    sets: tuple[ViewSet, ...]
    pairs: Float
    coupled: bool
    settings: PlanSettings

    def get(self, views: int, kind: str = "best") -> ViewSet:
        """The set of a number of views.

        Parameters
        ----------
        views : int
            Number of views.
        kind : {"best", "even"}
            Which of the two sets of as many views.

        Returns
        -------
        ViewSet
            The set.

        Raises
        ------
        InputError
            If the plan has no such set.
        """
        for s in self.sets:
            if len(s) == views and s.kind == kind:
                return s
        raise InputError("plan", f"there is no {kind} set of {views} views", "ask for it in PlanSettings.views")

    def to_table(self) -> pd.DataFrame:
        """One row a set and grain: where the grain is (mm) and its predicted sd (mm and degrees)."""
        import pandas as pd  # takes half a second and 60 MB

        parts = []
        for s in self.sets:
            sd = s.sd
            sd[:, 3:] = np.rad2deg(sd[:, 3:])
            part = pd.DataFrame(np.hstack([self.centers, sd]), columns=[*PLAN_COLUMNS[1:4], *PLAN_COLUMNS[6:]])
            parts.append(part.assign(label=self.labels, views=len(s), set=s.kind))
        return pd.concat(parts, ignore_index=True)[list(PLAN_COLUMNS)]

    def angles_table(self) -> pd.DataFrame:
        """One row a set: its angles, medians over the grains of the predicted sd, and motions to expect."""
        import pandas as pd  # takes half a second and 60 MB

        diameter = float(np.median(self.diameters))
        rows = []
        for s in self.sets:
            translation, rotation = s.sd_translation, s.sd_rotation_deg
            rows.append(
                {
                    "views": len(s),
                    "set": s.kind,
                    "angles_deg": " ".join(f"{a:g}" for a in s.angles_deg),
                    "surface_sd_voxel": s.criterion / self.voxel_size,
                    "sd_u_mm": np.median(translation),
                    "sd_u_voxel": np.median(translation) / self.voxel_size,
                    "sd_w_deg": np.median(rotation),
                    "worst_sd_u_voxel": translation.max() / self.voxel_size,
                    "worst_sd_w_deg": rotation.max(),
                    "capture": str(s.capture),
                    "capture_mm": max(d for d, _ in s.capture.ranges) * diameter,
                    "room_across_mm": s.room[0],
                    "room_along_mm": s.room[1],
                }
            )
        return pd.DataFrame(rows)

    def _summary(self) -> Summary:
        rows = []
        for s in self.sets:
            angles = ", ".join(f"{angle:.4g}°" for angle in s.angles_deg)
            sd = f"sd {np.median(s.sd_translation) / self.voxel_size:.2g} voxel, {np.median(s.sd_rotation_deg):.2g}°"
            rows.append((f"{len(s)} views, {s.kind}", f"{angles}: {sd}"))
        title = f"Plan for {len(self.labels)} grains from {len(self.angles_deg)} candidate views"
        counts = ", ".join(str(count) for count in sorted({len(s) for s in self.sets}))
        return Summary(title, f"sets of {counts} views", tuple(rows))


@renamed_arguments(views="geometry")
@checked_arguments
def plan(
    grains: GrainSet, geometry: Geometry, settings: PlanSettings | None = None, *, progress: Progress | None = None
) -> Plan:
    """Predict the precision of each grain's motion, choose the angles of the views, and give the capture range.

    The precision is the Cramér–Rao bound of photon noise and a model error, see `planning.fisher_information`; the
    choice is by exchange, see `planning.view_selection`.

    Parameters
    ----------
    grains : GrainSet
        The grains of the reference state.
    geometry : Geometry
        The candidate views, from which sets are chosen; for a circular scan those at
        `planning.candidates.candidate_angles`.
    settings : PlanSettings, optional
        Exposure, numbers of views, model error.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    Plan
        The sets of views with their predicted standard deviations.

    Raises
    ------
    InputError
        If there are fewer candidates than views wanted, or no candidate sees a grain.

    Examples
    --------
    >>> candidates = case.scanner.geometry((0, 45, 90, 135))
    >>> plan = gm.plan(grains, candidates, gm.PlanSettings(views=(2,)))
    >>> len(plan.to_table()) > 0
    True
    """
    settings = settings or PlanSettings()
    counts = sorted(set(settings.views))
    if counts[-1] > len(geometry):
        fact = f"{counts[-1]} views wanted of {len(geometry)} candidates"
        raise InputError("plan.views", fact, "ask for fewer views, or give a smaller plan.step_deg")
    with threadpool_limits(limits=1, user_api="blas"):  # the matrices are small
        return _plan(Candidates(grains, geometry, settings), counts, progress)


def _plan(candidates: Candidates, counts: list[int], progress: Progress | None) -> Plan:
    angles, packed = candidates.geometry.azimuths_deg, candidates.grain_arrays
    selector = ViewSelector.of(candidates, progress)
    if not selector.stacks.any():
        raise InputError("plan", "no candidate view sees a grain", "check the geometry and the volume's place")
    pairs = selector.pairs(progress)
    best: tuple[int, ...] = selector.best_pair(pairs)
    sets = []
    for count in range(2, counts[-1] + 1):
        if progress is not None:
            progress("choosing the angles", count - 2, counts[-1] - 1)
        best = selector.extend(best) if count > 2 else best
        even = even_set(angles, count)
        if count in counts:
            sets += [_view_set("best", best, candidates, angles)]
            sets += [_view_set("even", even, candidates, angles)] if even is not None else []
    return Plan(
        candidates.grains.labels, candidates.grains.centers, 2 * packed.radii, packed.voxel_size, candidates.geometry,
        angles, tuple(sets), pairs, selector.coupled, candidates.settings,
    )  # fmt: skip


def _view_set(kind: str, views: tuple[int, ...], candidates: Candidates, angles: Float) -> ViewSet:
    covariances = candidates.covariances(views)
    geometry = candidates.geometry[list(views)]
    return ViewSet(
        kind, views, angles[list(views)], covariances, candidates.surface_sd(covariances),
        room(candidates.grain_arrays, geometry), expected_capture(len(views)),
    )  # fmt: skip
