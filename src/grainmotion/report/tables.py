"""Content of the page's tables as text: facts, counts by status, corrections of the views, grains."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from grainmotion.model.fluid import FluidFit
from grainmotion.model.motions import Status
from grainmotion.model.state_fit import BodyMotion, StateFit
from grainmotion.report.data import Rows, StateReport

UNKNOWN_TURN_DEG = 30.0
"""Standard deviation from which a turn is not known: a round piston's about its axis has 104°, that of any angle."""


def number(value: float, decimals: int) -> str:
    """A number with a fixed count of decimals and a true minus sign; – for NaN and infinity."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{decimals}f}"
    return (text[1:] if float(text) == 0 and text.startswith("-") else text).replace("-", "−")


def significant(value: float, digits: int = 3) -> str:
    """A number with a few significant digits, trailing zeros kept; – for NaN and infinity."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    if 1e-4 <= abs(value) < 1e6:
        return number(value, max(0, digits - 1 - math.floor(math.log10(abs(value)))))
    return f"{value:.{digits - 1}e}".replace("-", "−")


def length_decimals(voxel_size: float) -> int:
    """Decimals that show a thousandth of a voxel."""
    return max(0, math.ceil(-math.log10(voxel_size * 1e-3) - 1e-9))


@dataclass(frozen=True)
class SummaryRow:
    """Summary of a state: grains by status; translations and rotations to use; typical motion, uncertainty and fit."""

    name: str
    grains: int
    counts: tuple[tuple[str, int], ...]
    to_use: tuple[int, int]
    values: tuple[str, ...]


def summary_row(state: StateReport) -> SummaryRow:
    """Counts by status; medians of motion and standard deviation over the results to use; fit."""
    motions, fit = state.motions, state.motions.fit
    counts = tuple((s.value, int((motions.statuses == s.value).sum())) for s in Status)
    translations, rotations = motions.ok_translation, motions.ok_rotation
    translation = _median(np.linalg.norm(motions.translations[translations], axis=1))
    rotation_deg = _median(np.rad2deg(np.linalg.norm(motions.rotations[rotations], axis=1)))
    variances = np.diagonal(motions.covariances, axis1=1, axis2=2)
    sd_translation = _median(np.sqrt(variances[translations, :3].mean(axis=1)))
    sd_rotation_deg = _median(np.rad2deg(np.sqrt(variances[rotations, 3:].mean(axis=1))))
    values = (
        number(translation, length_decimals(state.voxel_size)),
        number(translation / state.voxel_size, 3),
        number(rotation_deg, 3),
        significant(sd_translation, 2),
        significant(sd_rotation_deg, 2),
        significant(fit.costs[-1][1]) if fit.costs else "–",
        f"{fit.gain:.4f}",
        significant(fit.offset),
    )
    return SummaryRow(state.name, len(motions), counts, (int(translations.sum()), int(rotations.sum())), values)


def fit_facts(state: StateReport) -> Rows:
    """The fit of a state as a whole: gain, residual, detector response, motion of the background."""
    fit = state.motions.fit
    facts = [
        ("results to use", state.motions.counts),
        ("views", str(len(state.views))),
        ("gain a", f"{fit.gain:.5f}"),
        ("offset b₀", significant(fit.offset)),
    ]
    if fit.costs:
        facts.append(("relative residual at the end", significant(fit.costs[-1][1])))
        facts.append(("iterations", str(len(fit.costs))))
    if len(fit.start_residuals) == 2:
        before, expected = map(significant, fit.start_residuals)
        taken = ("the state before", "the extrapolation of the last two states")[fit.best_start]
        facts.append(("started from", f"{taken} (residuals of the two: {before}, {expected})"))
    response = fit.response
    if response is not None and np.ptp(response.polynomial[:, 0]) > 0:
        facts.append(("gain of each view", ", ".join(f"{g:.4f}" for g in response.polynomial[:, 0])))
    if response is not None and response.polynomial.shape[1] > 1:
        powers = ", ".join(f"{significant(c)} p^{k}" for k, c in enumerate(response.polynomial[0, 1:], start=2))
        facts.append(("beam hardening", powers))
    if fit.fluid is not None:
        facts += fluid_facts(fit.fluid)
    if fit.downweighted:
        facts.append(("pixels behind grains with less weight", f"{fit.downweighted:.2%}"))
    return tuple(facts)


def fluid_facts(fluid: FluidFit) -> list[tuple[str, str]]:
    """Attenuation and level of a liquid, and what the grains displaced where it changed."""
    facts = [("attenuation of the liquid", f"{_with_sd(fluid.attenuation, fluid.attenuation_sd)} 1/mm")]
    full = np.isnan(fluid.level)
    level = "the top of the field, or above" if full else f"{_with_sd(fluid.level, fluid.level_sd)} mm"
    facts.append(("level of the liquid (z)", level))
    if not np.isnan(fluid.displaced):
        name = "share of the grains' own space that fills and drains with it (0: solid grains)"
        facts.append((name, _with_sd(1 - fluid.displaced, fluid.displaced_sd)))
    return facts


def scene_sentences(fit: StateFit) -> list[str]:
    """What bodies did in a state, what appeared or broke, and where the liquid is: a sentence each."""
    sentences = []
    for body in fit.bodies:
        sentences.append(f"{body.name} {_moved_by(body)}")
    if fit.appeared:
        places = "; ".join(
            f"x = {g.center[0]:.3g}, y = {g.center[1]:.3g}, z = {g.center[2]:.3g}, radius {g.radius:.3g} mm"
            for g in fit.appeared
        )
        count = len(fit.appeared)
        what = "a grain has" if count == 1 else f"{count} grains have"
        sentences.append(f"{what} appeared that the reference does not have: {places}")
    broken = len({piece.label for piece in fit.pieces})
    if broken:
        sentences.append(f"{broken} broken grain{'s' * (broken != 1)} in {len(fit.pieces)} pieces")
    if fit.fluid is not None:
        sentences.append("; ".join(f"{name} {value}" for name, value in fluid_facts(fit.fluid)))
    return sentences


def _moved_by(body: BodyMotion) -> str:
    """How far a body moved and turned, with standard deviations; the axes about which its turn is not known."""
    if not body.moved:
        return "did not move"
    degrees, covariance = np.rad2deg(body.rotation), np.rad2deg(np.rad2deg(body.covariance[3:, 3:]))
    known = ~(np.sqrt(np.diagonal(covariance)) > UNKNOWN_TURN_DEG)
    turn = _length_with_sd(degrees[known], covariance[np.ix_(known, known)])
    text = f"moved by {_length_with_sd(body.translation, body.covariance[:3, :3])} mm and {turn}°"
    unknown = [axis for axis, is_known in zip("xyz", known) if not is_known]
    return text + (f", its turn about {' and '.join(unknown)} not determined" if unknown else "")


def _length_with_sd(vector: np.ndarray, covariance: np.ndarray) -> str:
    """Length of a vector with the standard deviation along it."""
    length = float(np.linalg.norm(vector))
    along = vector / length if length > 0 else vector
    return _with_sd(length, float(np.sqrt(max(along @ covariance @ along, 0.0))))


def correction_rows(fit: StateFit, views: tuple[str, ...]) -> list[tuple[str, list[str]]]:
    """Shift of each view's panel along u and v (pixels) and angle of its stage (degrees), with standard deviations."""
    if fit.view_corrections is None:
        return []
    values, deviations = fit.view_corrections.columns, fit.view_corrections_sd
    sd = np.full_like(values, np.nan) if deviations is None else deviations.columns
    units = np.array([1.0, 1.0, np.rad2deg(1.0)])
    pairs = zip(views, values * units, sd * units, strict=True)
    return [
        (view, [f"{number(v, 4)} ± {number(d, 4)}" for v, d in zip(value, deviation)])
        for view, value, deviation in pairs
    ]


def body_rows(state: StateReport) -> list[tuple[str, str, list[str]]]:
    """Name of each body, whether it moved, and u (mm) and ω (degrees) with their standard deviations."""
    rows, decimals = [], length_decimals(state.voxel_size)
    for body in state.motions.fit.bodies:
        sd = np.sqrt(np.diagonal(body.covariance))
        values = ["–"] * 6
        if body.moved:
            values = [f"{number(u, decimals)} ± {significant(d, 2)}" for u, d in zip(body.translation, sd[:3])]
            turns = zip(np.rad2deg(body.rotation), np.rad2deg(sd[3:]))
            values += [
                "not determined" if d > UNKNOWN_TURN_DEG else f"{number(w, 3)} ± {significant(d, 2)}" for w, d in turns
            ]
        word = "moved" if body.moved else ("fixed" if body.freedom == "fixed" else "did not move")
        rows.append((body.name, word, values))
    return rows


def appeared_rows(state: StateReport) -> list[tuple[str, list[str]]]:
    """Number of each grain that appeared; its place and radius (mm) with standard deviations, attenuation (1/mm)."""
    decimals = length_decimals(state.voxel_size)
    rows = []
    for number_of, grain in enumerate(state.motions.fit.appeared, start=1):
        lengths = zip([*grain.center, grain.radius], [*grain.center_sd, grain.radius_sd], strict=True)
        values = [f"{number(x, decimals)} ± {significant(sd, 2)}" for x, sd in lengths]
        rows.append((str(number_of), [*values, significant(grain.attenuation)]))
    return rows


def piece_rows(state: StateReport) -> list[tuple[str, str, list[str]]]:
    """Grain and piece, status, share of the grain, and u (mm) and ω (degrees) with their standard deviations."""
    rows, decimals = [], length_decimals(state.voxel_size)
    for piece in state.motions.fit.pieces:
        sd = np.sqrt(np.diagonal(piece.covariance))
        values = [f"{number(u, decimals)} ± {significant(d, 2)}" for u, d in zip(piece.translation, sd[:3])]
        turns = zip(np.rad2deg(piece.rotation), np.rad2deg(sd[3:]))
        values += [f"{number(w, 3)} ± {significant(d, 2)}" for w, d in turns]
        rows.append((f"{piece.label}, piece {piece.piece}", piece.status, [f"{piece.share:.0%}", *values]))
    return rows


def _with_sd(value: float, sd: float) -> str:
    """A value to the second digit of its standard deviation, with that; to five digits where it has none."""
    if not (math.isfinite(sd) and sd > 0):
        return f"{value:.5g}"
    return f"{number(value, max(0, 1 - math.floor(math.log10(sd))))} ± {significant(sd, 2)}"


def _median(values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else math.nan
