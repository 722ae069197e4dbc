"""Motions: the result of tracking one state, grain by grain."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grainmotion.errors import InputError
from grainmotion.model.grain_motion import GrainMotion
from grainmotion.model.motion_table import OK_COLUMNS, fields_from_table, table_from_fields
from grainmotion.model.state_fit import StateFit
from grainmotion.model.status import STATUS_COLOURS, Status, status_counts
from grainmotion.model.strain import stretches
from grainmotion.model.summary import Summarised, Summary
from grainmotion.model.thumbnails import arrows_picture
from grainmotion.model.usable_parts import parts_to_use
from grainmotion.rotations import rotation_matrix

if TYPE_CHECKING:
    import pandas as pd

Value = TypeVar("Value", bound=np.generic)


def _checked_labels(labels: ArrayLike) -> NDArray[np.integer]:
    """Labels as an array; rows of other numbers, or two rows of one grain, would be joined to the wrong grains."""
    array = np.asarray(labels)
    if array.size and array.dtype.kind not in "iu":
        raise InputError("motions.labels", f"they are {array.dtype}", "give integers")
    known, counts = np.unique(array, return_counts=True)
    if counts.size and counts.max() > 1:
        raise InputError("motions.labels", f"grain {known[counts.argmax()]} is there twice", "give each grain one row")
    return array


@dataclass(frozen=True, eq=False, repr=False)
class Motions(Summarised):
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

    Examples
    --------
    >>> len(motions), motions.status_counts
    (4, {'converged': 4})
    >>> motions.to_table()[["label", "ux", "uy", "uz"]].shape
    (4, 4)
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
        object.__setattr__(self, "labels", _checked_labels(self.labels))
        for name, shape in shapes.items():
            object.__setattr__(self, name, np.asarray(getattr(self, name)))  # lists would not compare by element
            if np.shape(getattr(self, name)) != shape:
                raise InputError(f"motions.{name}", f"shape {np.shape(getattr(self, name))}", f"give {shape}")
        if len(self.reasons) != n:
            raise InputError("motions.reasons", f"{len(self.reasons)} sentences", f"give {n}")
        unknown = {str(s) for s in self.statuses} - {s.value for s in Status}
        if unknown:
            raise InputError("motions.status", f"{sorted(unknown)} unknown", f"use {[s.value for s in Status]}")
        parts = parts_to_use(self.statuses, self.reasons, self.ok_translation, self.ok_rotation)
        for name, flags in zip(OK_COLUMNS, parts, strict=True):
            object.__setattr__(self, name, flags)

    def __len__(self) -> int:
        return len(self.labels)

    def __iter__(self) -> Iterator[GrainMotion]:
        return (self._row(row) for row in range(len(self)))

    def __contains__(self, label: object) -> bool:
        return label in self.labels.tolist()

    def __getitem__(self, label: int) -> GrainMotion:
        """The motion of one grain, by its label."""
        rows = np.flatnonzero(self.labels == label)
        if not len(rows):
            fact, remedy = f"there is no grain {label}", "give one of motions.labels; all are motions.to_table()"
            raise InputError("motions", fact, remedy)
        return self._row(int(rows[0]))

    def _row(self, row: int) -> GrainMotion:
        return GrainMotion(
            int(self.labels[row]), str(self.statuses[row]), self.centers[row], self.translations[row],
            self.rotations[row], self.covariances[row], float(self.residuals[row]), self.reasons[row],
            bool(self.ok_translation[row]), bool(self.ok_rotation[row]),
            None if self.strains is None else self.strains[row],
        )  # fmt: skip

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

    def to_dataframe(self) -> pd.DataFrame:
        """The table of ``motions.csv``: mm and degrees, one row a grain.

        Returns
        -------
        DataFrame
            Its ``attrs`` tell units and meanings of the columns, the frame and the version.  `from_table` reads it.
        """
        return self.to_table()

    def to_table(self) -> pd.DataFrame:
        """The table of ``motions.csv``, as `to_dataframe`."""
        return table_from_fields({
            "labels": self.labels, "centers": self.centers, "translations": self.translations,
            "rotations": self.rotations, "covariances": self.covariances, "statuses": self.statuses,
            "residuals": self.residuals, "iterations": self.iterations, "reasons": self.reasons,
            "ok_translation": self.ok_translation, "ok_rotation": self.ok_rotation,
            "strains": self.strains, "strain_covariances": self.strain_covariances,
        })  # fmt: skip

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
        return cls(**fields_from_table(table, where))

    def _summary(self) -> Summary:
        u, degrees = (
            np.linalg.norm(v[ok], axis=1)
            for v, ok in ((self.translations, self.ok_translation), (np.rad2deg(self.rotations), self.ok_rotation))
        )
        rows = [("results to use", self.counts)]
        rows += [("|u|", f"median {np.median(u):.3g}, up to {u.max():.3g} mm")] if len(u) else []
        rows += [("|ω|", f"median {np.median(degrees):.3g}, up to {degrees.max():.3g}°")] if len(degrees) else []
        rows += [("strain", "of each grain, too")] if self.strains is not None else []
        rows += [("note", note) for note in self.fit.notes[:3]]
        picture = arrows_picture(
            self.centers[:, [0, 2]], np.where(self.ok_translation[:, None], self.translations, np.nan)[:, [0, 2]],
            [STATUS_COLOURS[str(status)] for status in self.statuses],
        )  # fmt: skip
        title = f"Motions of {len(self)} grains"
        return Summary(title, f"|u| {rows[1][1]}" if len(u) else "", tuple(rows), picture, self.status_counts)

    @property
    def status_counts(self) -> dict[str, int]:
        """Number of grains of each status that occurs."""
        return status_counts(self.statuses)
