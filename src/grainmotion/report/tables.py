"""Tables of the page: facts, counts by status, grains."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from grainmotion.model.motions import COLUMNS, Motions, StateFit, Status
from grainmotion.report.data import Rows, StateReport

STATUS_COLOURS = {
    Status.CONVERGED.value: "#2a9d68",
    Status.POORLY_DETERMINED.value: "#d99a1c",
    Status.NOT_CONVERGED.value: "#d1453b",
    Status.LEFT_FIELD.value: "#7b6fd0",
    Status.NOT_FITTED.value: "#8b929c",
}

GROUPS = (  # heading and the columns of motions.csv under it, with their units
    ("", ("label", "status"), ""),
    ("centre in the reference state", ("x", "y", "z"), "mm"),
    ("translation", ("ux", "uy", "uz"), "mm"),
    ("rotation vector", ("wx", "wy", "wz"), "°"),
    ("standard deviation of u", ("sd_ux", "sd_uy", "sd_uz"), "mm"),
    ("standard deviation of ω", ("sd_wx", "sd_wy", "sd_wz"), "°"),
    ("fit", ("residual", "iterations"), ""),
    ("", ("reason",), ""),
)


def number(value: float, decimals: int) -> str:
    """A number with a fixed count of decimals, a true minus sign, and – where there is none."""
    if not math.isfinite(value):
        return "–"
    text = f"{value:.{decimals}f}"
    return (text[1:] if float(text) == 0 and text.startswith("-") else text).replace("-", "−")


def significant(value: float, digits: int = 3) -> str:
    """A number with a few significant digits, trailing zeros kept, and – where there is none."""
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


def facts_table(rows: Rows) -> str:
    """Name and value, a row a fact."""
    body = "".join(f"<tr><th scope=row>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f"<table class=facts><tbody>{body}</tbody></table>" if rows else ""


def status_mark(status: str, text: str | None = None) -> str:
    """A status as a coloured word."""
    return f'<span class="status {status}">{escape(text if text is not None else status)}</span>'


def summary_table(states: Sequence[StateReport]) -> str:
    """A row a state: counts by status, typical motion, typical uncertainty, fit."""
    head = ["state", "grains", *(s.value.replace("-", "-<br>") for s in Status)]
    head += ["median<br>|u| (mm)", "median<br>|u| (voxel)", "median<br>|ω| (°)"]
    head += ["median<br>sd u (mm)", "median<br>sd ω (°)", "relative<br>residual", "gain<br>a", "offset<br>b₀"]
    rows = []
    for i, state in enumerate(states):
        m = state.motions
        counts = [int((m.statuses == s.value).sum()) for s in Status]
        marks = [status_mark(s.value, str(n)) if n else "0" for s, n in zip(Status, counts)]
        shift = _median(np.linalg.norm(m.translations, axis=1))
        turn = _median(np.rad2deg(np.linalg.norm(m.rotations, axis=1)))
        with np.errstate(invalid="ignore"):
            sd = np.sqrt(np.diagonal(m.covariances, axis1=1, axis2=2))
        decimals = length_decimals(state.voxel_size)
        cells = [f'<a href="#state-{i}">{escape(state.name)}</a>', str(len(m)), *marks]
        cells += [number(shift, decimals), number(shift / state.voxel_size, 3), number(turn, 3)]
        cells += [significant(_median(sd[:, :3]), 2), significant(_median(np.rad2deg(sd[:, 3:])), 2)]
        cells += [significant(m.fit.costs[-1][1]) if m.fit.costs else "–"]
        cells += [f"{m.fit.gain:.4f}", significant(m.fit.offset)]
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    heads = "".join(f"<th scope=col>{cell}</th>" for cell in head)
    body = f"<thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody>"
    return f"<div class=scroll><table class=summary>{body}</table></div>"


def response_facts(fit: StateFit) -> list[tuple[str, str]]:
    """What was found of the detector's response and of the background, beyond one gain and offset."""
    facts = []
    response = fit.response
    if response is not None and np.ptp(response.polynomial[:, 0]) > 0:
        facts.append(("gain of each view", ", ".join(f"{g:.4f}" for g in response.polynomial[:, 0])))
    if response is not None and response.polynomial.shape[1] > 1:
        powers = ", ".join(f"{significant(c)} p^{k}" for k, c in enumerate(response.polynomial[0, 1:], start=2))
        facts.append(("beam hardening", powers))
    if fit.background is not None:
        shift, turn = (float(np.linalg.norm(part)) for part in (fit.background[:3], np.rad2deg(fit.background[3:])))
        facts.append(("background moved", f"{significant(shift)} mm, {significant(turn)}°"))
    if fit.downweighted:
        facts.append(("shaded pixels counted less", f"{fit.downweighted:.2%}"))
    return facts


def corrections_table(fit: StateFit, views: tuple[str, ...]) -> str:
    """Shift of each view's panel and angle of its stage, with standard deviations."""
    assert fit.corrections is not None
    sd = np.full_like(fit.corrections, np.nan) if fit.corrections_sd is None else fit.corrections_sd
    rows = []
    for view, value, deviation in zip(views, fit.corrections, sd, strict=True):
        pairs = zip([*value[:2], np.rad2deg(value[2])], [*deviation[:2], np.rad2deg(deviation[2])])
        cells = "".join(f"<td>{v:.4f} ± {d:.4f}</td>" for v, d in pairs)
        rows.append(f"<tr><td>{escape(view)}</td>{cells}</tr>")
    heads = "".join(f"<th scope=col>{t}</th>" for t in ("view", "along u (pixels)", "along v (pixels)", "angle (°)"))
    table = f"<table><thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
    return f"<div class=scroll>{table}</div>"


def attention_list(motions: Motions) -> str:
    """The grains that did not converge, by status and reason."""
    groups: dict[tuple[str, str], list[int]] = {}
    for label, status, reason in zip(motions.labels, motions.statuses, motions.reasons):
        if status != Status.CONVERGED.value:
            groups.setdefault((str(status), reason), []).append(int(label))
    if not groups:
        return f"<p>All {len(motions)} grains {status_mark(Status.CONVERGED.value)}.</p>" if len(motions) else ""
    items = []
    for (status, reason), labels in groups.items():
        who = ("grain " if len(labels) == 1 else "grains ") + _enumerate(labels)
        items.append(f"<li>{status_mark(status)} {who}{': ' if reason else ''}{escape(reason)}</li>")
    return f"<p>Grains to look at:</p><ul class=attention>{''.join(items)}</ul>"


def grain_table(state: StateReport, most: int) -> str:
    """All columns of ``motions.csv`` and the reasons, for at most ``most`` grains; headings sort."""
    motions = state.motions
    table = motions.to_table()
    order = np.arange(len(table))
    note = ""
    if len(table) > most:
        order = np.argsort(motions.ok, kind="stable")[:most]
        note = f"<p>{most} of {len(table)} grains, those to look at first; motions.csv holds all.</p>"
    decimals = length_decimals(state.voxel_size)
    columns = [_column(table[name].to_numpy()[order], name, decimals) for name in COLUMNS]
    reasons = (escape(motions.reasons[i]) for i in order)
    body = "".join(
        "<tr>" + "".join(f"<td>{cell}" for cell in row) + f"<td class=reason>{reason}"
        for row, reason in zip(zip(*columns), reasons)
    )
    groups = "".join(
        f"<th colspan={len(names)} scope=colgroup>{title}{f' ({unit})' if unit else ''}</th>"
        for title, names, unit in GROUPS
    )
    heads = "".join(
        f"<th scope=col aria-sort=none><button type=button>{name}</button></th>"
        for _, names, _ in GROUPS
        for name in names
    )
    return (
        f'{note}<div class="scroll tall"><table class=grains><thead><tr class=groups>{groups}</tr>'
        f"<tr>{heads}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _column(values: np.ndarray, name: str, decimals: int) -> Iterable[str]:
    if name == "status":
        return [status_mark(str(v)) for v in values]
    if name in ("label", "iterations"):
        return [str(int(v)) for v in values]
    if name.startswith("sd_"):
        return [significant(v, 2) for v in values]
    if name == "residual":
        return [significant(v) for v in values]
    return [number(v, 3 if name.startswith("w") else decimals) for v in values]


def _median(values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if values.size else math.nan


def _enumerate(labels: list[int], most: int = 40) -> str:
    shown = ", ".join(map(str, labels[:most]))
    return shown if len(labels) <= most else f"{shown} and {len(labels) - most} more"
