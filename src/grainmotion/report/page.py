"""The page itself: sections, styles and scripts put together in one file that needs no network."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator
from datetime import datetime
from html import escape
from importlib import metadata, resources
from pathlib import Path

import numpy as np
import plotly.offline
from numpy.typing import NDArray

from grainmotion.io.files import written_whole
from grainmotion.report import curves, images, tables
from grainmotion.report.arrows import scenes
from grainmotion.report.data import ReportData, StateReport

PIXELS = 1_600_000  # of all radiographs on the page together: about 2 MB
MAX_ROWS = 5_000  # grains in all tables together: about 2 MB
MAX_ARROWS = 3_000  # grains drawn in three dimensions, all states together: about 2 MB
LARGEST = 640_000  # of one image
LEAST = 4_000
SLICE = 160_000  # pixels of a slice of the volume
LINE_INTEGRAL = "line integral −ln(I/I₀)"
CITATION = (
    "M. H. Khalili, S. Brisard, M. Bornert, P. Aimedieu, J.-M. Pereira and J.-N. Roux, “Discrete Digital "
    "Projections Correlation: A Reconstruction-Free Method to Quantify Local Kinematics in Granular Media by "
    "X-ray Tomography”, <i>Experimental Mechanics</i> 57(6), 2017, "
    '<a href="https://doi.org/10.1007/s11340-017-0263-5">doi 10.1007/s11340-017-0263-5</a>.'
)
PACKAGES = ("grainmotion", "numpy", "scipy", "numba", "scikit-image", "matplotlib", "plotly")


def write_report(path: str | Path, data: ReportData) -> None:
    """Write one HTML page that opens offline: radiographs, convergence, grains, arrows.

    Large radiographs are averaged over blocks of pixels, so that the page stays below about 10 MB.

    Parameters
    ----------
    path : path
        The file to write, usually ``report.html``; it is replaced once the new page is whole.
    data : ReportData
        What to show.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with written_whole(path) as part, part.open("w", encoding="utf-8") as stream:
        stream.writelines(_page(data))


def _page(data: ReportData) -> Iterator[str]:
    title = escape(data.title)
    # The policy keeps browsers from fetching anything at all.
    policy = "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
    yield '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">\n'
    yield f'<meta http-equiv="Content-Security-Policy" content="{policy}">\n'
    yield f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{title}</title>\n'
    yield f"<style>{_asset('page.css')}</style></head>\n<body>\n{_header(data)}\n<main>\n"
    yield _summary(data)
    yield _reference(data)
    pixels = _pixels_each(data.states)
    for i, state in enumerate(data.states):
        yield _state(i, state, pixels, MAX_ROWS // len(data.states))
    if data.states:
        yield _arrows(data.states)
    yield f"</main>\n{_footer()}\n"
    yield '<dialog id="zoom" aria-label="Enlarged view"></dialog>\n'
    yield f"<script>{_asset('page.js')}</script>\n</body></html>\n"


def _header(data: ReportData) -> str:
    links = ["<a href='#summary'>Summary</a>", "<a href='#reference'>Reference</a>"]
    links += [f'<a href="#state-{i}">{escape(state.name)}</a>' for i, state in enumerate(data.states)]
    links += ["<a href='#arrows'>Displacements in 3-D</a>"] if data.states else []
    written = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M")
    return (
        f"<header><h1>{escape(data.title)}</h1>"
        f"<p class=quiet>grainmotion {_version('grainmotion')} · {written}</p></header>"
        f"<nav>{''.join(links)}</nav>"
    )


def _summary(data: ReportData) -> str:
    if not data.states:
        return '<section id="summary"><h2>Summary</h2><p>No later state has been tracked yet.</p></section>\n'
    return (
        f'<section id="summary"><h2>Summary</h2>{tables.summary_table(data.states)}'
        "<p class=quiet>Lengths in mm, rotations in degrees, in the sample frame (z up, along the rotation "
        "axis). A grain’s motion carries X to x = Ω (X − c) + u + c, with c its centre of mass in the "
        "reference state and Ω the rotation by the rotation vector ω. Medians over the grains that have a "
        "motion.</p></section>\n"
    )


def _reference(data: ReportData) -> str:
    parts = [
        '<section id="reference"><h2>Reference state</h2><div class=columns>',
        tables.facts_table(data.facts),
    ]
    if data.reconstruction_errors:
        caption = "Reconstruction: relative residual ε after each iteration."
        parts.append(_figure(curves.reconstruction_svg(data.reconstruction_errors), caption))
    parts.append("</div>")
    if data.volume is not None:
        array, size = data.volume.array, data.volume.voxel_size
        scale = images.grey_scale(array)
        parts.append("<h3>Central slices</h3><div class=slices>")
        for name, index in _slices(array.shape):
            cut = array[index][::-1]
            pair = _image(images.png(images.shrink(cut, SLICE)[0], scale), f"attenuation, {name}")
            if data.labels is not None:
                step = max(1, int(np.ceil(np.sqrt(cut.size / SLICE))))
                labels = data.labels[index][::-1][::step, ::step]
                pair += _image(images.label_png(labels), f"labels, {name}")
            width, height = cut.shape[1] * size, cut.shape[0] * size
            parts.append(_figure(f"<div class=pair>{pair}</div>", f"{name}: {width:.4g} × {height:.4g} mm"))
        parts.append(f"</div>{_bar(scale, 'attenuation (1/mm)')}")
    return "".join(parts) + "</section>\n"


def _state(i: int, state: StateReport, pixels: int, most: int) -> str:
    parts = [
        f'<section id="state-{i}" class=state><h2>{escape(state.name)}</h2>',
        tables.attention_list(state.motions),
    ]
    fit = state.motions.fit
    parts.append("<div class=columns><div><h3>Fit</h3>")
    facts = [
        ("views", str(len(state.views))),
        ("gain a", f"{fit.gain:.5f}"),
        ("offset b₀", tables.significant(fit.offset)),
    ]
    if fit.costs:
        facts.append(("relative residual at the end", tables.significant(fit.costs[-1][1])))
        facts.append(("iterations", str(len(fit.costs))))
    parts.append(tables.facts_table(tuple(facts + tables.response_facts(fit))))
    parts += [f"<p>{escape(note)}</p>" for note in fit.notes]
    if fit.corrections is not None:
        parts.append(f"<h3>Poses of the views</h3>{tables.corrections_table(fit, state.views)}")
    if state.comparison:
        parts.append(f"<h3>Comparison</h3>{tables.facts_table(state.comparison)}")
    parts.append("</div>")
    if fit.costs:
        caption = "Relative residual after each iteration; stages that filter the images differently do not compare."
        parts.append(_figure(curves.convergence_svg(fit.costs), caption))
    parts.append(f"</div><h3>Radiographs</h3>{_radiographs(state, pixels)}")
    table = tables.grain_table(state, most)
    parts.append(f"<h3>Grains</h3><p class='quiet screen'>Click a heading to sort.</p>{table}")
    return "".join(parts) + "</section>\n"


def _radiographs(state: StateReport, pixels: int) -> str:
    assert state.residual is not None  # StateReport fills it
    grey = images.grey_scale(state.measured, state.simulated)
    diverging = images.diverging_scale(state.residual)
    blocks = []
    for view, caption in enumerate(state.views):
        cells, k = [], 1
        for name, stack, scale in (
            ("measured", state.measured, grey),
            ("simulated", state.simulated, grey),
            ("residual", state.residual, diverging),
        ):
            image = stack[view][::-1] if state.first_row == "bottom" else stack[view]
            image, k = images.shrink(image, pixels)
            cells.append(_figure(_image(images.png(image, scale), f"{name}, {caption}"), name))
        shrunk = f", averaged over {k} × {k} pixels" if k > 1 else ""
        rms, whole = _rms(state.residual[view]), _rms(state.measured[view])
        share = f" ({tables.significant(100 * rms / whole, 2)} % of measured)" if whole > 0 else ""
        note = f"<b>{escape(caption)}</b> · residual, root mean square: {tables.significant(rms)}{share}{shrunk}"
        blocks.append(f"<div class=view><p>{note}</p><div class=trio>{''.join(cells)}</div></div>")
    bars = _bar(grey, f"measured and simulated: {LINE_INTEGRAL}") + _bar(diverging, f"residual: {LINE_INTEGRAL}")
    return f"<div class=bars>{bars}</div><div class=views>{''.join(blocks)}</div>"


def _arrows(states: tuple[StateReport, ...]) -> str:
    most = MAX_ARROWS // len(states)
    figures = [scenes(state.motions, state.voxel_size, most) for state in states]
    names = "".join(f"<option>{escape(state.name)}</option>" for state in states)
    kinds = "".join(f"<option>{escape(kind)}</option>" for kind in figures[0]["arrows"])
    data = json.dumps(figures, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    data = data.replace("<", "\\u003c")
    return (
        '<section id="arrows"><h2>Displacements in 3-D</h2><p class=choices>'
        f"<label>State <select id=arrows-state>{names}</select></label> "
        f"<label>Arrows <select id=arrows-kind>{kinds}</select></label> "
        "<span id=arrows-note class=quiet></span></p>"
        '<div id="arrows-plot"></div><img id="arrows-print" alt="">'
        "<p class=quiet>Arrows start at the grains’ centres in the reference state; a grain without a motion "
        "has no arrow. Drag to turn, scroll to zoom.</p>"
        f'<script type="application/json" id="arrows-data">{data}</script>'
        f"<script>{plotly.offline.get_plotlyjs()}</script></section>\n"
    )


def _footer() -> str:
    versions = ", ".join(f"{name} {_version(name)}" for name in PACKAGES)
    return (
        "<footer><h2>Versions and how to cite</h2>"
        f"<p>Made by {escape(versions)}, Python {platform.python_version()}, {escape(platform.system())}.</p>"
        "<p>The method is D-DPC, Discrete Digital Projection Correlation. "
        f"Please cite {CITATION}</p></footer>"
    )


def _rms(image: NDArray[np.floating]) -> float:
    values = image[np.isfinite(image)].astype(float)
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")


def _slices(shape: tuple[int, ...]) -> list[tuple[str, tuple[int | slice, ...]]]:
    z, y, x = (n // 2 for n in shape)
    whole = slice(None)
    return [
        ("x →, y ↑ at mid z", (z, whole, whole)),
        ("x →, z ↑ at mid y", (whole, y, whole)),
        ("y →, z ↑ at mid x", (whole, whole, x)),
    ]


def _pixels_each(states: tuple[StateReport, ...]) -> int:
    count = 3 * sum(len(state.views) for state in states)
    return int(np.clip(PIXELS // max(1, count), LEAST, LARGEST))


def _figure(content: str, caption: str) -> str:
    return f"<figure>{content}<figcaption>{escape(caption)}</figcaption></figure>"


def _image(address: str, description: str) -> str:
    return f'<img src="{address}" alt="{escape(description)}">'


def _bar(scale: images.GreyScale, unit: str) -> str:
    middle = "<span>0</span>" if scale.palette == "diverging" else ""
    ends = (tables.significant(v) for v in (scale.low, scale.high))
    low, high = (f"<span>{end}</span>" for end in ends)
    return (
        f"<div class=bar><span class=unit>{escape(unit)}</span>"
        f'<img src="{images.bar(scale.palette)}" alt=""><div class=ticks>{low}{middle}{high}</div></div>'
    )


def _asset(name: str) -> str:
    return resources.files("grainmotion.report").joinpath(name).read_text(encoding="utf-8")


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "(unknown version)"
