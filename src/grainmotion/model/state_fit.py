"""The fit of one state as a whole: detector, alignment, liquid and the motions of bodies beside the grains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from typing_extensions import deprecated

from grainmotion._typing import Float
from grainmotion.model.detector_response import Response
from grainmotion.model.fluid import FluidFit
from grainmotion.model.pose import ViewCorrections
from grainmotion.model.summary import Summarised, Summary, value_text
from grainmotion.model.thumbnails import curve_picture
from grainmotion.rotations import rotation_matrix


@dataclass(frozen=True, eq=False, repr=False)
class BodyMotion(Summarised):
    """Motion of one body beside the grains, such as a piston, from the reference state to a later one.

    Attributes
    ----------
    name, kind, freedom : str
        As in `Body`; ``freedom`` is the text of the ways in which it may move.
    center : (3,) array
        Attenuation-weighted centre of mass in the reference state, mm, x y z.
    translation, rotation : (3,) arrays
        u, mm, and the rotation vector ω about the centre, radians, sample frame; zero if it did not move.
    covariance : (6, 6) array
        Of (ux, uy, uz, ωx, ωy, ωz), mm and radians; NaN if it did not move.
    moved : bool
        Whether it moved, as far as the radiographs show; else it was fixed where it was in the reference.
    """

    name: str
    kind: str
    freedom: str
    center: NDArray[np.float64]
    translation: NDArray[np.float64]
    rotation: NDArray[np.float64]
    covariance: NDArray[np.float64]
    moved: bool

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Rotation matrix Ω ``(3, 3)``."""
        return rotation_matrix(self.rotation)


@dataclass(frozen=True, eq=False, repr=False)
class NewGrain(Summarised):
    """A grain of a state that the reference does not have, as an ellipsoid.

    Attributes
    ----------
    center, center_sd : (3,) arrays
        Its centre in this state, mm, x y z, and its standard deviations.
    radius, radius_sd : float
        Radius of the ball of the same volume, mm, and its standard deviation.
    attenuation : float
        Of the ellipsoid, 1/mm.
    """

    center: NDArray[np.float64]
    center_sd: NDArray[np.float64]
    radius: float
    radius_sd: float
    attenuation: float


@dataclass(frozen=True, eq=False, repr=False)
class PieceMotion(Summarised):
    """Motion of one piece of a grain that broke, from the reference state to a later one.

    Attributes
    ----------
    label : int
        Label of the grain in the reference volume.
    piece : int
        1 for the largest piece of the grain, 2 for the next.
    share : float
        Share of the grain's attenuation, and so of its volume, in this piece.
    center : (3,) array
        Centre of mass of the piece in the reference state, mm, x y z.
    translation, rotation : (3,) arrays
        u, mm, and the rotation vector ω about the piece's centre, radians, sample frame.
    covariance : (6, 6) array
        Of (ux, uy, uz, ωx, ωy, ωz), mm and radians.
    status : str
        As `Motions.statuses`: that of the piece fitted as a grain.
    """

    label: int
    piece: int
    share: float
    center: NDArray[np.float64]
    translation: NDArray[np.float64]
    rotation: NDArray[np.float64]
    covariance: NDArray[np.float64]
    status: str

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Rotation matrix Ω ``(3, 3)``."""
        return rotation_matrix(self.rotation)


@dataclass(frozen=True, eq=False, repr=False)
class StateFit(Summarised):
    """How the fit of one state went as a whole.

    Attributes
    ----------
    gain, offset : float
        a and b of Eq. 22: measured ≈ a · simulated + b; means over views where each has its own.
    costs : tuple of (str, float)
        Stage and relative residual ‖F(b − m(P))‖/‖F b‖ after each iteration, in order, under the
        stage's own filter F (so that stages with different filters do not compare).
    response : Response, optional
        Fitted response of the detector; None if only gain and offset are known.
    view_corrections, view_corrections_sd : ViewCorrections, optional
        Shift of each view's panel and angle of its stage, and their standard deviations.  None where they were not
        estimated.
    bodies : tuple of BodyMotion
        Motion of each body beside the grains.
    downweighted : float
        Share of the pixels in the grains' footprints to which a robust loss gave less weight.
    notes : tuple of str
        Sentences on the state as a whole, such as refused options and unexplained attenuation.
    fluid : FluidFit, optional
        Attenuation and level of the liquid in this state; None if the reference is dry.
    appeared : tuple of NewGrain
        Grains of this state that the reference does not have.
    pieces : tuple of PieceMotion
        Motions of the pieces of grains that broke.
    start_residuals : tuple of float
        Where the best of several starts was taken, the relative residual of the radiographs at each, under the first
        stage's filter; in a run those of the state before and of the extrapolation of the last two states.

    Examples
    --------
    >>> bool(abs(motions.fit.gain - 1) < 0.01), len(motions.fit.costs) > 0
    (True, True)
    """

    gain: float = 1.0
    offset: float = 0.0
    costs: tuple[tuple[str, float], ...] = ()
    response: Response | None = None
    view_corrections: ViewCorrections | None = None
    view_corrections_sd: ViewCorrections | None = None
    bodies: tuple[BodyMotion, ...] = ()
    downweighted: float = 0.0
    notes: tuple[str, ...] = ()
    fluid: FluidFit | None = None
    appeared: tuple[NewGrain, ...] = ()
    pieces: tuple[PieceMotion, ...] = ()
    start_residuals: tuple[float, ...] = ()

    def of_views(self, views: Sequence[int]) -> StateFit:
        """The same fit for some of its views.

        Parameters
        ----------
        views : sequence of int
            Which, in the order of the radiographs.

        Returns
        -------
        StateFit
            With the response and the corrections of these views; all else is of the state as a whole.
        """
        rows = list(views)
        response = self.response and Response(self.response.polynomial[rows], self.response.background[rows])
        moved, sd = (
            known and ViewCorrections.of(known.columns[rows])
            for known in (self.view_corrections, self.view_corrections_sd)
        )
        return replace(self, response=response, view_corrections=moved, view_corrections_sd=sd)

    @property
    def best_start(self) -> int:
        """Which of several starts was taken, from 0; 0 where one was given."""
        return int(np.argmin(self.start_residuals)) if self.start_residuals else 0

    @property
    def background(self) -> NDArray[np.float64] | None:
        """Motion (u, ω) ``(6,)`` of the first body that may move, mm and radians; None if there is none."""
        for body in self.bodies:
            if body.freedom != "fixed":
                return np.concatenate([body.translation, body.rotation])
        return None

    @property
    @deprecated("StateFit.corrections is now StateFit.view_corrections")
    def corrections(self) -> Float | None:
        """Columns of `view_corrections`, pixels, pixels and radians, ``(views, 3)``."""
        return None if self.view_corrections is None else self.view_corrections.columns

    @property
    @deprecated("StateFit.corrections_sd is now StateFit.view_corrections_sd")
    def corrections_sd(self) -> Float | None:
        """Columns of `view_corrections_sd`, pixels, pixels and radians, ``(views, 3)``."""
        return None if self.view_corrections_sd is None else self.view_corrections_sd.columns

    def _summary(self) -> Summary:
        rows = [("gain, offset", f"{self.gain:.5g}, {self.offset:.3g}")]
        if self.costs:
            stage, cost = self.costs[-1]
            rows.append(("convergence", f"{len(self.costs)} iterations, residual {cost:.3g} in '{stage}'"))
        rows += [("views", "shifts and angles were estimated")] if self.view_corrections is not None else []
        moved = [body.name for body in self.bodies if body.moved]
        rows += [("bodies", f"{len(self.bodies)}, moved: {', '.join(moved) or 'none'}")] if self.bodies else []
        rows += [("fluid", value_text(self.fluid))] if self.fluid is not None else []
        rows += [("appeared", f"{len(self.appeared)} grains")] if self.appeared else []
        rows += [("broken", f"{len(self.pieces)} pieces")] if self.pieces else []
        rows += [("note", note) for note in self.notes]
        line = ", ".join(f"{name} {value}" for name, value in rows[:2])
        return Summary("StateFit", line, tuple(rows), curve_picture(np.array([cost for _, cost in self.costs])))
