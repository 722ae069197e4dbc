"""A load series: the motions of many states in order, from the reference and from state to state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.model.summary import Summarised, Summary, counted_rows, names_text
from grainmotion.rotations import rotation_matrix
from grainmotion.sequences.extrapolation import rotation_steps
from grainmotion.sequences.table import SeriesFields, series_table

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class Series(Summarised):
    """Motions of the same n grains in s states, in loading order.

    Cumulative motions are those from the reference, as tracked.  An increment is the motion from the state before, of
    the first state from the reference; it is about the grain's centre where it was in that state.

    Attributes
    ----------
    states : tuple of s str
        Names of the states.
    motions : tuple of s Motions
        From the reference to each state, with the same grains in the same order.
    times : (s,) array
        Of each state, seconds since the reference; NaN where not told.

    Examples
    --------
    >>> series = gm.Series.of({"step-01": motions, "step-02": motions})
    >>> series.states, series.translations.shape
    (('step-01', 'step-02'), (2, 4, 3))
    """

    states: tuple[str, ...]
    motions: tuple[Motions, ...]
    times: NDArray[np.float64]

    def __post_init__(self) -> None:
        if not self.states:
            raise InputError("series", "no state", "give the motions of one state or more")
        if len(self.motions) != len(self.states) or np.shape(self.times) != (len(self.states),):
            fact = f"{len(self.states)} names, {len(self.motions)} motions, times of shape {np.shape(self.times)}"
            raise InputError("series", fact, "give one of each for every state")
        if len(set(self.states)) < len(self.states):
            raise InputError("series", "a state's name is given twice", "give each state its own name")
        told = np.asarray(self.times)[np.isfinite(self.times)]
        if np.any(np.diff(told) <= 0):
            raise InputError("series", "times do not increase", "give the states in loading order, times in seconds")
        first = self.motions[0]
        for name, motions in zip(self.states, self.motions, strict=True):
            if not np.array_equal(motions.labels, first.labels) or not np.allclose(motions.centers, first.centers):
                fact = f"state '{name}' has other grains than '{self.states[0]}', or other centres of them"
                raise InputError("series", fact, "give motions from one reference; Series.of sorts their rows")

    @classmethod
    @checked_arguments
    def of(cls, motions: Mapping[str, Motions], times: Mapping[str, float] | None = None) -> Series:
        """The series of motions by the names of their states.

        Parameters
        ----------
        motions : mapping of str to Motions
            In loading order, all from the same reference; rows are matched by label.
        times : mapping of str to float, optional
            Seconds since the reference, of the states for which they are known.

        Returns
        -------
        Series
            With the grains in the order of the first state.

        Raises
        ------
        InputError
            If there is no state, the states have not the same grains, or times do not increase.
        """
        rows = list(motions.values())
        first = rows[:1]
        ordered = tuple(
            m.for_grains(first[0].labels, first[0].centers) if set(m.labels) == set(first[0].labels) else m
            for m in rows
        )
        told = {} if times is None else times
        unknown = [name for name in told if name not in motions]
        if unknown:
            raise InputError(
                "series", f"a time of '{unknown[0]}', which is no state", f"the states are {', '.join(motions)}"
            )
        return cls(tuple(motions), ordered, np.array([told.get(name, np.nan) for name in motions], dtype=float))

    def __len__(self) -> int:
        return len(self.states)

    def __getitem__(self, state: str) -> Motions:
        if state not in self.states:
            raise InputError("series", f"no state '{state}'", f"the states are {', '.join(self.states)}")
        return self.motions[self.states.index(state)]

    @property
    def labels(self) -> NDArray[np.int64]:
        """Labels of the grains ``(n,)``."""
        return self.motions[0].labels

    @property
    def centers(self) -> Float:
        """Centres of mass in the reference state ``(n, 3)``, mm, x y z."""
        return self.motions[0].centers

    @property
    def translations(self) -> Float:
        """u from the reference ``(s, n, 3)``, mm; see ``motions`` for which of them are results to use."""
        return np.array([m.translations for m in self.motions])

    @property
    def rotations(self) -> Float:
        """Rotation vectors ω from the reference ``(s, n, 3)``, radians, of length at most π."""
        return np.array([m.rotations for m in self.motions])

    @cached_property
    def used_translations(self) -> Float:
        """``translations``, NaN where not a result to use."""
        ok = np.array([m.ok_translation for m in self.motions])
        return np.where(ok[..., None], self.translations, np.nan)

    @cached_property
    def used_rotations(self) -> Float:
        """``rotations``, NaN where not a result to use."""
        ok = np.array([m.ok_rotation for m in self.motions])
        return np.where(ok[..., None], self.rotations, np.nan)

    @cached_property
    def increments(self) -> Float:
        """Δu of each grain's centre from the state before ``(s, n, 3)``, mm; NaN unless both are results to use."""
        return np.diff(_with_reference(self.used_translations), axis=0)

    @cached_property
    def rotation_increments(self) -> Float:
        """Rotation vectors δ of exp[δ]ₓ = Ω Ω₋ᵀ with Ω₋ of the state before ``(s, n, 3)``, radians, sample frame."""
        every = _with_reference(self.used_rotations)
        return rotation_steps(every[:-1], every[1:])

    @cached_property
    def increment_sd(self) -> Float:
        """Standard deviations of ``increments`` and ``rotation_increments`` ``(s, n, 6)``, mm and radians.

        The errors of two states are taken as independent: C + J C₋ Jᵀ, where J turns the rotation part of C₋ by the
        increment, since exp[δ]ₓ Ω Ω₋ᵀ exp[−δ₋]ₓ = exp[δ − Ω Ω₋ᵀ δ₋]ₓ Ω Ω₋ᵀ.
        """
        covariances = np.array([m.covariances for m in self.motions])
        before = np.concatenate([np.zeros_like(covariances[:1]), covariances[:-1]])
        turns = rotation_matrix(np.nan_to_num(self.rotation_increments))
        variances = np.diagonal(covariances, axis1=-2, axis2=-1).copy()
        variances[..., :3] += np.diagonal(before, axis1=-2, axis2=-1)[..., :3]
        variances[..., 3:] += np.einsum("...ij,...jk,...ik->...i", turns, before[..., 3:, 3:], turns)
        sd = np.sqrt(variances)
        known = np.concatenate([np.isfinite(self.increments), np.isfinite(self.rotation_increments)], axis=-1)
        return np.where(known, sd, np.nan)

    @cached_property
    def paths(self) -> Float:
        """Length of the way of each grain's centre from the reference ``(s, n)``, mm; NaN where u is no result to use.

        Straight from state to state, and across states in which it is not known.  Noise lengthens it, where steps are
        not large beside the standard deviation.
        """
        return _path(_with_reference(self.used_translations), lambda a, b: b - a)

    @cached_property
    def rotation_paths(self) -> Float:
        """Sum of the angles by which each grain rotated from state to state ``(s, n)``, radians; likewise."""
        return _path(_with_reference(self.used_rotations), rotation_steps)

    def to_table(self) -> pd.DataFrame:
        """Cumulative and incremental motions of all states, one row a state and grain, in mm and degrees.

        Returns
        -------
        DataFrame
            The columns of `grainmotion.sequences.table.SERIES_COLUMNS`; its ``attrs`` hold their units and meanings,
            the frame and the version.
        """
        return series_table(
            SeriesFields(
                self.states, self.times, self.motions, self.increments, self.rotation_increments, self.increment_sd,
                self.paths, self.rotation_paths,
            )
        )  # fmt: skip

    def _summary(self) -> Summary:
        named = {}
        for name, motions, time in zip(self.states, self.motions, self.times, strict=True):
            named[name + (f" at {time:.6g} s" if np.isfinite(time) else "")] = motions.status_counts
        title = f"Series of {len(self)} state{'s' if len(self) > 1 else ''} of {len(self.labels)} grains"
        return Summary(title, names_text(self.states), counted_rows(named))


_Step = Callable[[Float, Float], Float]


def _with_reference(values: Float) -> Float:
    """Values of all states ``(s, n, 3)`` after those of the reference, where nothing moved: ``(s + 1, n, 3)``."""
    return np.concatenate([np.zeros_like(values[:1]), values])


def _path(every: Float, step: _Step) -> Float:
    """Sum of the lengths of all steps up to each state ``(s, n)``, from one known state to the next."""
    out = np.full(every.shape[:2], np.nan)
    out[0] = 0.0
    last, length = every[0].copy(), np.zeros(every.shape[1])
    for k in range(1, len(every)):
        known = np.isfinite(every[k]).all(axis=1)
        length[known] += np.linalg.norm(step(last[known], every[k][known]), axis=1)
        last[known] = every[k][known]
        out[k, known] = length[known]
    return out[1:]
