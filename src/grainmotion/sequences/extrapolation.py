"""Motions of the next state, continued from the last two on the group of rigid motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.model.motions import Motions
from grainmotion.rotations import recenter, rotation_matrix, rotation_vector


@checked_arguments
def extrapolate(before: Motions | None, last: Motions, *, ratio: float = 1.0) -> Motions:
    """Expect the motions of the next state: each grain goes on as it moved between the last two states.

    With subscripts 1 and 2 of the last two states and the ratio r, u = u₂ + r (u₂ − u₁) about the same centre, and
    Ω = exp[r δ]ₓ Ω₂ with exp[δ]ₓ = Ω₂ Ω₁ᵀ, so that a rotation past 180° meets no jump.

    Parameters
    ----------
    before : Motions, optional
        The state before the last; none is the reference, where nothing has moved.
    last : Motions
        The last state.
    ratio : float
        Time from the last state to the next over that between the last two; 1 for equal steps.

    Returns
    -------
    Motions
        Of the grains of ``last``, not fitted.  A translation, and a rotation, that is not a result to use in both
        states stays as in ``last``.

    Raises
    ------
    InputError
        If the ratio is negative or not finite.

    Examples
    --------
    After a first state, all grains are expected to go on as they moved:

    >>> expected = gm.extrapolate(None, motions)
    >>> np.allclose(expected.translations, 2 * motions.translations)
    True
    """
    if not (np.isfinite(ratio) and ratio >= 0):
        raise InputError("extrapolate(ratio)", f"got {ratio:g}", "give a ratio of times, 0 or more")
    expected = Motions.identity(last.labels, last.centers)
    first = expected if before is None else _about_centers_of(last, before)
    known = np.ones(len(last), dtype=bool)
    ok_u = (known if before is None else first.ok_translation) & last.ok_translation
    ok_w = (known if before is None else first.ok_rotation) & last.ok_rotation
    ok_u &= np.isfinite(first.translations).all(axis=1) & np.isfinite(last.translations).all(axis=1)
    ok_w &= np.isfinite(first.rotations).all(axis=1) & np.isfinite(last.rotations).all(axis=1)
    translations, rotations = last.translations.copy(), last.rotations.copy()
    translations[ok_u] += ratio * (last.translations - first.translations)[ok_u]
    step = rotation_steps(first.rotations[ok_w], last.rotations[ok_w])
    rotations[ok_w] = rotation_vector(rotation_matrix(ratio * step) @ rotation_matrix(last.rotations[ok_w]))
    return replace(expected, translations=translations, rotations=rotations)


def _about_centers_of(last: Motions, before: Motions) -> Motions:
    """The motions ``before`` of the grains of ``last``, about their centres there: they may be of another labelling."""
    first = before.for_grains(last.labels, last.centers)
    alike = np.isclose(first.centers, last.centers) | ~np.isfinite(first.rotations)
    same: NDArray[np.bool_] = np.all(alike, axis=1)
    matrices = rotation_matrix(np.where(same[:, None], 0.0, first.rotations))
    shifted = recenter(matrices, first.translations, first.centers, last.centers)
    return replace(first, translations=np.where(same[:, None], first.translations, shifted), centers=last.centers)


def rotation_steps(first: Float, second: Float) -> Float:
    """Rotation vectors δ ``(..., 3)`` of exp[δ]ₓ = Ω₂ Ω₁ᵀ, radians, in the sample frame; NaN of NaN."""
    finite: NDArray[np.bool_] = np.all(np.isfinite(first) & np.isfinite(second), axis=-1)
    steps = np.full(np.shape(second), np.nan)
    matrices = rotation_matrix(second[finite]) @ np.swapaxes(rotation_matrix(first[finite]), -1, -2)
    steps[finite] = rotation_vector(matrices)
    return steps
