"""Motions: the result of tracking one state, grain by grain."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import deprecated

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.detector_response import Response
from grainmotion.model.fluid import FluidFit
from grainmotion.model.pose import ViewCorrections
from grainmotion.model.strain import STRAIN_NAMES, stretches
from grainmotion.rotations import rotation_matrix

if TYPE_CHECKING:
    import pandas as pd

Value = TypeVar("Value", bound=np.generic)


class Status(StrEnum):
    """Outcome of the fit of a grain; `Motions.reasons` gives cause and remedy."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not-converged"
    POORLY_DETERMINED = "poorly-determined"
    LEFT_FIELD = "left-field"
    NOT_FITTED = "not-fitted"
    AMBIGUOUS = "ambiguous"
    ABSENT = "absent"
    CUT = "cut"
    BROKEN = "broken"
    DEFORMED = "deformed"


MOTION_COLUMNS = (
    "label", "status", "x", "y", "z", "ux", "uy", "uz", "wx", "wy", "wz",
    "sd_ux", "sd_uy", "sd_uz", "sd_wx", "sd_wy", "sd_wz", "residual", "iterations",
)  # fmt: skip
REASON_COLUMN = "reason"
"""Column of ``motions.csv`` after `MOTION_COLUMNS`; files of older versions lack it."""
OK_COLUMNS = ("ok_translation", "ok_rotation")
"""Columns of ``motions.csv`` after `REASON_COLUMN`; files of older versions lack them."""
STRAIN_COLUMNS = (*STRAIN_NAMES, *(f"sd_{name}" for name in STRAIN_NAMES))
"""Last columns of ``motions.csv``, where strains were measured."""
PARTIAL = (Status.CUT.value, Status.DEFORMED.value, Status.BROKEN.value)
"""Statuses of grains whose translation or rotation may be a result to use; the classification says which."""
POORLY_DETERMINED_REASON = "poorly determined: "
"""Beginning of the reason of a poorly determined grain; what is not determined follows, up to a semicolon."""


@dataclass(frozen=True, eq=False)
class BodyMotion:
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


@dataclass(frozen=True, eq=False)
class StateFit:
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


@dataclass(frozen=True, eq=False)
class Motions:
    """Motion of each of n grains from the reference state to one later state.

    Attributes
    ----------
    labels : (n,) int array
        Labels in the reference volume.
    centers : (n, 3) array
        Attenuation-weighted centres of mass in the reference state, mm, x y z.
    translations : (n, 3) array
        u, mm, sample frame.
    rotations : (n, 3) array
        Rotation vectors ω about the centres, **radians**, right-hand rule, x y z.
    covariances : (n, 6, 6) array
        Of (ux, uy, uz, ωx, ωy, ωz), mm and radians; the rotation part is of the increment δ in
        Ω ← exp[δ]ₓ Ω.  NaN where not estimated.
    statuses : (n,) array of Status strings
    residuals : (n,) array
        Root mean square of (measured − simulated) over the grain's footprint, line-integral units.
    iterations : (n,) int array
    reasons : tuple of n str
        A sentence a grain: cause and remedy; empty for grains that converged.
    fit : StateFit
        Gain, offset and convergence curve of the state.
    ok_translation, ok_rotation : (n,) bool array
        Whether u, and whether ω, is a result to use: both of a grain that converged; of a poorly determined one that
        which is determined; of an ambiguous one its translation; of one that is cut, deformed or broken what the
        classification found good; of all others neither.  Where not given they follow from statuses and reasons.
    strains : (n, 6) array, optional
        Biot strain e = U − I of each grain in the frame of the reference: exx, eyy, ezz, eyz, exz, exy, with
        x = Ω U (X − c) + u + c (see `grainmotion.model.strain`).  None for grains taken as rigid.
    strain_covariances : (n, 6, 6) array, optional
        Of the six strains.
    """

    labels: NDArray[np.int64]
    centers: NDArray[np.float64]
    translations: NDArray[np.float64]
    rotations: NDArray[np.float64]
    covariances: NDArray[np.float64]
    statuses: NDArray[np.str_]
    residuals: NDArray[np.float64]
    iterations: NDArray[np.int64]
    reasons: tuple[str, ...]
    fit: StateFit = field(default_factory=StateFit)
    ok_translation: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    ok_rotation: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    strains: NDArray[np.float64] | None = None
    strain_covariances: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        n = len(self.labels)
        shapes = {
            "centers": (n, 3), "translations": (n, 3), "rotations": (n, 3), "covariances": (n, 6, 6),
            "statuses": (n,), "residuals": (n,), "iterations": (n,),
        }  # fmt: skip
        if self.strains is not None:
            shapes |= {"strains": (n, 6), "strain_covariances": (n, 6, 6)}
        for name, shape in shapes.items():
            if np.shape(getattr(self, name)) != shape:
                raise InputError(f"motions.{name}", f"shape {np.shape(getattr(self, name))}", f"give {shape}")
        if len(self.reasons) != n:
            raise InputError("motions.reasons", f"{len(self.reasons)} sentences", f"give {n}")
        unknown = {str(s) for s in self.statuses} - {s.value for s in Status}
        if unknown:
            raise InputError("motions.status", f"{sorted(unknown)} unknown", f"use {[s.value for s in Status]}")
        for name, flags in zip(OK_COLUMNS, self._parts_to_use(), strict=True):
            object.__setattr__(self, name, flags)

    def _parts_to_use(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Translations and rotations to use, as far as statuses and reasons decide it, else as given."""
        n = len(self.labels)
        given = [np.asarray(getattr(self, name), dtype=bool) for name in OK_COLUMNS]
        # flags of another length were not given, or `replace` kept them while all else is of other grains
        translation, rotation = (flags.copy() if flags.shape == (n,) else np.zeros(n, dtype=bool) for flags in given)
        poor = self.statuses == Status.POORLY_DETERMINED.value
        whole = poor & translation & rotation  # a contradiction: the status is newer
        named = [r.partition(";")[0] if r.startswith(POORLY_DETERMINED_REASON) else "" for r in self.reasons]
        told = poor & np.array([bool(name) for name in named], dtype=bool)
        ok, ambiguous = self.ok, self.statuses == Status.AMBIGUOUS.value
        partial = poor & ~whole | np.isin(self.statuses, PARTIAL)
        for flags, part, always in ((translation, "translation", ok | ambiguous), (rotation, "rotation", ok)):
            by_name = np.array([part not in name for name in named], dtype=bool)
            flags[:] = always | np.where(told, by_name, flags & partial)
        return translation, rotation

    def __len__(self) -> int:
        return len(self.labels)

    @classmethod
    def identity(cls, labels: NDArray[np.int64], centers: NDArray[np.float64]) -> Motions:
        """No motion, not fitted: the usual start.

        Parameters
        ----------
        labels : (n,) int array
            Labels of the grains.
        centers : (n, 3) array
            Their centres of mass in the reference state, mm, x y z.

        Returns
        -------
        Motions
            Zero translations and rotations, status ``not-fitted``.
        """
        n = len(labels)
        return cls(
            labels=np.asarray(labels),
            centers=np.asarray(centers, dtype=float),
            translations=np.zeros((n, 3)),
            rotations=np.zeros((n, 3)),
            covariances=np.full((n, 6, 6), np.nan),
            statuses=np.full(n, Status.NOT_FITTED.value, dtype="<U20"),
            residuals=np.full(n, np.nan),
            iterations=np.zeros(n, dtype=np.int64),
            reasons=("",) * n,
        )

    @property
    def matrices(self) -> NDArray[np.float64]:
        """Rotation matrices Ω ``(n, 3, 3)``."""
        return rotation_matrix(self.rotations)

    @property
    def stretches(self) -> NDArray[np.float64]:
        """Right stretches U = I + e ``(n, 3, 3)``; the identity where no strain is known."""
        return stretches(np.zeros((len(self), 6)) if self.strains is None else np.nan_to_num(self.strains))

    @property
    def gradients(self) -> NDArray[np.float64]:
        """Deformation gradients F = Ω U ``(n, 3, 3)``: the rotations themselves for rigid grains."""
        return self.matrices if self.strains is None else self.matrices @ self.stretches

    @property
    def strain_sd(self) -> NDArray[np.float64] | None:
        """Standard deviations of the strains ``(n, 6)``; None for grains taken as rigid."""
        if self.strain_covariances is None:
            return None
        return np.asarray(np.sqrt(np.diagonal(self.strain_covariances, axis1=1, axis2=2)))

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Grains that converged, ``(n,)``."""
        return self.statuses == Status.CONVERGED.value

    @property
    def usable(self) -> NDArray[np.bool_]:
        """Grains with a motion to use, ``(n,)``: in all or in part, or but for the directions that are named."""
        return self.ok_translation | self.ok_rotation | (self.statuses == Status.POORLY_DETERMINED.value)

    @property
    def counts(self) -> str:
        """How many translations and rotations are results to use, as ``75 translations, 37 rotations of 75``."""
        return f"{self.ok_translation.sum()} translations, {self.ok_rotation.sum()} rotations of {len(self)}"

    def for_grains(self, labels: NDArray[np.int64], centers: NDArray[np.float64]) -> Motions:
        """The motions of other grains, matched by label.

        Parameters
        ----------
        labels : (m,) int array
            Labels in the reference volume.
        centers : (m, 3) array
            Centres of mass of grains that have no row here, mm, x y z; those of others are ignored.

        Returns
        -------
        Motions
            The row of each label where there is one, else no motion, not fitted.
        """
        row_of = {int(label): row for row, label in enumerate(self.labels)}
        rows = np.array([row_of.get(int(label), -1) for label in labels], dtype=np.int64)
        known = rows >= 0
        other = Motions.identity(labels, centers)

        def merged(own: NDArray[Value], new: NDArray[Value]) -> NDArray[Value]:
            new = new.copy()
            new[known] = own[rows[known]]
            return new

        def merged_strains(own: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
            return None if own is None else merged(own, np.full((len(labels), *own.shape[1:]), np.nan))

        return Motions(
            other.labels, merged(self.centers, other.centers), merged(self.translations, other.translations),
            merged(self.rotations, other.rotations), merged(self.covariances, other.covariances),
            merged(self.statuses, other.statuses), merged(self.residuals, other.residuals),
            merged(self.iterations, other.iterations),
            tuple(self.reasons[row] if row >= 0 else "" for row in rows), self.fit,
            merged(self.ok_translation, other.ok_translation), merged(self.ok_rotation, other.ok_rotation),
            merged_strains(self.strains), merged_strains(self.strain_covariances),
        )  # fmt: skip

    def to_table(self) -> pd.DataFrame:
        """The table of ``motions.csv``: mm and degrees, one row a grain."""
        import pandas as pd  # takes half a second, which a fit does not need

        sd = np.sqrt(np.diagonal(self.covariances, axis1=1, axis2=2)).copy()
        sd[:, 3:] = np.rad2deg(sd[:, 3:])
        numbers = np.concatenate([self.centers, self.translations, np.rad2deg(self.rotations), sd], axis=1)
        table = pd.DataFrame(numbers, columns=list(MOTION_COLUMNS[2:17]))
        table.insert(0, "label", self.labels)
        table.insert(1, "status", self.statuses)
        table["residual"] = self.residuals
        table["iterations"] = self.iterations
        table[REASON_COLUMN] = [_plain_text(reason) for reason in self.reasons]
        for name in OK_COLUMNS:
            table[name] = getattr(self, name)
        if self.strains is not None and self.strain_sd is not None:
            table[list(STRAIN_COLUMNS)] = np.hstack([self.strains, self.strain_sd])
        return table

    @classmethod
    def from_table(cls, table: pd.DataFrame, where: str = "motions table") -> Motions:
        """Read the table of ``motions.csv``; covariances get the variances alone.

        Parameters
        ----------
        table : DataFrame
            The columns of `to_table`, mm and degrees; the reasons and what follows them may be missing.
        where : str
            Name of the table in errors.

        Returns
        -------
        Motions
            mm and radians.

        Raises
        ------
        InputError
            If a column is missing, naming ``where``.
        """
        missing = [c for c in MOTION_COLUMNS if c not in table.columns]
        if missing:
            raise InputError(where, f"columns {missing} are missing", f"give {','.join(MOTION_COLUMNS)}")
        sd = table[list(MOTION_COLUMNS[11:17])].to_numpy(float, copy=True)
        sd[:, 3:] = np.deg2rad(sd[:, 3:])
        strains = strain_sd = None
        if set(STRAIN_COLUMNS) <= set(table.columns):
            strains, strain_sd = np.hsplit(table[list(STRAIN_COLUMNS)].to_numpy(float), 2)
        return cls(
            labels=table["label"].to_numpy(np.int64),
            centers=table[["x", "y", "z"]].to_numpy(float),
            translations=table[["ux", "uy", "uz"]].to_numpy(float),
            rotations=np.deg2rad(table[["wx", "wy", "wz"]].to_numpy(float)),
            covariances=sd[:, :, None] ** 2 * np.eye(6),
            statuses=table["status"].to_numpy(str).astype("<U20"),
            residuals=table["residual"].to_numpy(float),
            iterations=table["iterations"].to_numpy(np.int64),
            reasons=_reasons(table),
            ok_translation=_flags(table, "ok_translation"),
            ok_rotation=_flags(table, "ok_rotation"),
            strains=strains,
            strain_covariances=None if strain_sd is None else strain_sd[:, :, None] ** 2 * np.eye(6),
        )


def _plain_text(sentence: str) -> str:
    """A sentence in one line that no spreadsheet takes for a formula and no reader for a comment."""
    return " ".join(sentence.replace("#", "no. ").split()).lstrip("=+-@ ")


def _reasons(table: pd.DataFrame) -> tuple[str, ...]:
    if REASON_COLUMN not in table.columns:
        return ("",) * len(table)
    return tuple("" if reason != reason else str(reason) for reason in table[REASON_COLUMN])


def _flags(table: pd.DataFrame, name: str) -> NDArray[np.bool_]:
    """A column of `OK_COLUMNS`; empty if the table lacks it."""
    return table[name].to_numpy(bool) if name in table.columns else np.zeros(0, dtype=bool)
