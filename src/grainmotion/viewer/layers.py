"""Layers for napari, as its layer data tuples: data, keywords of the layer, and its type.

Lengths are in mm, axes in napari's order z y x.  What changes from state to state has the axis ``state`` before them:
0 is the reference, 1, 2, … are the states in loading order.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TypeAlias

import numpy as np

from grainmotion._typing import Float
from grainmotion.errors import InputError
from grainmotion.io.results_folder import ResultsFolder, read_results
from grainmotion.io.tiff import read_tiff
from grainmotion.model.motions import Motions
from grainmotion.model.volume import Volume
from grainmotion.viewer.grain_values import STATUS, check_value, colour_range, grain_colours, grain_table
from grainmotion.viewer.moving_surfaces import surface_layers
from grainmotion.workflow.outputs import RESIDUALS
from grainmotion.workflow.run import RunResult

LayerData: TypeAlias = tuple[object, dict[str, object], str]
"""napari's layer data tuple: data, keywords, type of the layer."""
ResultsLike: TypeAlias = ResultsFolder | RunResult | str | Path
"""Results of a run, or the folder that holds them."""
SPACE: dict[str, object] = {"units": ("mm", "mm", "mm"), "axis_labels": ("z", "y", "x")}
STATES_AND_SPACE: dict[str, object] = {
    "units": ("pixel", "mm", "mm", "mm"), "axis_labels": ("state", "z", "y", "x")
}  # fmt: skip
"""Units and names of the axes; napari calls numbers without a unit pixels."""
BRIGHTEST = 99.8
"""Percentile of the attenuation that is drawn white."""
ARROW_SHARE = 0.5
"""Of the distance between neighbouring centres, for the longest arrow but for a few."""
RESIDUAL_PERCENTILE = 99.5
"""Of the absolute residuals, for the limits of the colours."""


def layers(results: ResultsLike, *, value: str = "u", state: str | None = None) -> list[LayerData]:
    """Layers of napari that show the results of a run, in space.

    Parameters
    ----------
    results : ResultsFolder, RunResult or path
        What `read_results` or `run` returned, or the folder of the results.
    value : str
        What grains are coloured by: "u" or "w", length of the translation (mm) and angle of the rotation (degrees);
        "sd_u" or "sd_w", standard deviations of a component (root mean square of the three); "status"; or a number of
        ``motions.to_table()``, such as "uz" or "residual".
    state : str, optional
        The state that the labels tell; the last one unless given.  The other layers have all states.

    Returns
    -------
    list of (data, keywords, type)
        In drawing order: "reference" (image), "grains" (labels), "surfaces" (moved to each state; grains without a
        value are grey, in a layer of their own), "tracks" of the centres, "displacements" (vectors).  Each is a layer
        by ``napari.layers.Layer.create(*data)``.  Of a run without states only the first ones.

    Raises
    ------
    InputError
        If there are no such results, no such state or no such value.

    Examples
    --------
    >>> made = gm.viewer.layers("results")
    >>> all(len(data) == 3 for data in made)  # values, keywords, kind of layer
    True
    """
    stored = stored_results(results)
    motions = dict(stored.motions)
    for each in motions.values():
        check_value(each, value)
    if state is not None and state not in motions:
        raise InputError("state", f"no state '{state}'", f"the states are {', '.join(motions)}")
    shown = motions[state] if state is not None else next(reversed(motions.values()), None)
    made = [_volume_layer(stored.volume), _label_layer(stored, shown, value)]
    made += [(data, {**keys, **STATES_AND_SPACE}, "surface") for data, keys in surface_layers(stored, value)]
    if motions:
        made += [_tracks_layer(motions, value), _displacement_layer(motions, value)]
    return made


def residual_layers(results: ResultsLike) -> list[LayerData]:
    """Layers of napari with the residual radiographs of each state, measured minus simulated.

    Parameters
    ----------
    results : ResultsFolder, RunResult or path
        As in `layers`.

    Returns
    -------
    list of (data, keywords, type)
        One image a state, ``(views, rows, columns)``, the last one shown.  Pixels of the panel, which have no place in
        the sample: a window of their own is best.

    Raises
    ------
    InputError
        If there are no such results.

    Examples
    --------
    >>> [kind for values, keywords, kind in gm.viewer.residual_layers("results")]  # of two states
    ['image', 'image']
    """
    stored, made = stored_results(results), list[LayerData]()
    paths = {name: stored.folder / name / RESIDUALS for name in stored.motions}
    paths = {name: path for name, path in paths.items() if path.is_file()}
    for name, path in paths.items():
        images = read_tiff(path)
        size = np.abs(images[np.isfinite(images)])
        limit = float(np.percentile(size, RESIDUAL_PERCENTILE)) if size.size else 1.0
        keywords: dict[str, object] = {
            "name": f"residuals {name}",
            "colormap": "coolwarm",
            "contrast_limits": (-limit or -1.0, limit or 1.0),
            "axis_labels": ("view", "row", "column"),
            "visible": name == list(paths)[-1],
        }
        made.append((images, keywords, "image"))
    return made


def stored_results(results: ResultsLike) -> ResultsFolder:
    """The folder of results that is meant."""
    if isinstance(results, ResultsFolder):
        return results
    if isinstance(results, RunResult):
        return read_results(results.folder)
    if isinstance(results, str | Path):
        return read_results(results)
    fact = f"got {type(results).__name__}"
    raise InputError("results", fact, "give gm.read_results(folder), what gm.run returned, or the folder itself")


def _volume_layer(volume: Volume) -> LayerData:
    high = float(np.percentile(volume.array[::2, ::2, ::2], BRIGHTEST))
    keywords: dict[str, object] = {
        "name": "reference",
        "colormap": "gray",
        "contrast_limits": (0.0, high if high > 0 else 1.0),
        "rendering": "attenuated_mip",
        "visible": False,
    }
    return volume.array, keywords | _placed(volume), "image"


def _label_layer(stored: ResultsFolder, motions: Motions | None, value: str) -> LayerData:
    keywords: dict[str, object] = {"name": "grains", "opacity": 0.6, "visible": False}
    if motions is not None:
        colours = grain_colours(motions, value)
        clear = (0.0, 0.0, 0.0, 0.0)
        named: dict[int | None, tuple[float, ...]] = {
            int(label): tuple(colour) for label, colour in zip(motions.labels, colours, strict=True)
        }
        table = grain_table(motions).drop(columns=["x", "y", "z"])
        keywords["colormap"] = named | {None: clear, 0: clear}
        keywords["features"] = table.rename(columns={"label": "index"})
    return stored.labels, keywords | _placed(stored.volume), "labels"


def _tracks_layer(motions: Mapping[str, Motions], value: str) -> LayerData:
    """One track a grain from state to state; where a translation is no result to use, the track passes over."""
    import pandas as pd  # takes half a second and 60 MB

    rows, tables = list[Float](), []
    for step, each in enumerate((next(iter(motions.values())), *motions.values())):
        table = grain_table(each).select_dtypes(["number", "bool"]).astype(float)
        moves = each.translations if step else np.zeros_like(each.translations)
        known = each.ok_translation if step else np.ones(len(each), dtype=bool)
        if step == 0:
            table.loc[:, [name for name in table.columns if name not in ("label", "x", "y", "z")]] = 0.0
        places = (each.centers + moves)[:, ::-1]
        rows.append(np.column_stack([each.labels, np.full(len(each), step), places])[known])
        tables.append(table[known])
    keywords: dict[str, object] = {
        "name": "tracks",
        "features": pd.concat(tables, ignore_index=True).fillna(0.0),
        "color_by": "label" if value == STATUS else value,
        "colormap": "viridis",
        "tail_length": len(motions) + 1,
        "tail_width": 4,
    }
    return np.concatenate(rows), keywords | STATES_AND_SPACE, "tracks"


def _displacement_layer(motions: Mapping[str, Motions], value: str) -> LayerData:
    """An arrow a grain and state, from its centre in the reference along the translation, magnified."""
    import pandas as pd  # takes half a second and 60 MB

    arrows, tables = list[Float](), []
    for step, each in enumerate(motions.values(), start=1):
        known = each.ok_translation
        time = np.full((int(known.sum()), 1), float(step))
        start = np.hstack([time, each.centers[known, ::-1]])
        arrows.append(np.stack([start, np.hstack([0 * time, each.translations[known, ::-1]])], axis=1))
        tables.append(grain_table(each)[known].select_dtypes("number"))
    data, table = np.concatenate(arrows), pd.concat(tables, ignore_index=True)
    factor = _magnification(next(iter(motions.values())).centers, np.linalg.norm(data[:, 1], axis=1))
    by = "u" if value == STATUS else value
    name, limits = colour_range(table[by].to_numpy(float))
    keywords: dict[str, object] = {
        "name": "displacements" if factor == 1 else f"displacements × {factor:g}",
        "length": factor,
        "edge_width": 0.02 * _spacing(next(iter(motions.values())).centers),
        "vector_style": "arrow",
        "features": table.fillna(0.0),
        "edge_color": by,
        "edge_colormap": name,
        "edge_contrast_limits": limits,
        "out_of_slice_display": False,
    }
    return data, keywords | STATES_AND_SPACE, "vectors"


def _spacing(centers: Float) -> float:
    """Median distance to the nearest neighbour, mm; 1 for a single grain."""
    from scipy.spatial import cKDTree

    if len(centers) < 2:
        return 1.0
    distances = np.asarray(cKDTree(centers).query(centers, k=2)[0])
    return float(np.median(distances[:, 1]))


def _magnification(centers: Float, lengths: Float) -> float:
    """A round factor (1, 2, 5, 10, …) by which long arrows reach to the neighbour; never less than 1."""
    longest = float(np.percentile(lengths, 90)) if len(lengths) else 0.0
    if longest <= 0:
        return 1.0
    wanted = ARROW_SHARE * _spacing(centers) / longest
    power = 10.0 ** np.floor(np.log10(wanted))
    return max(1.0, float(power * max(step for step in (1, 2, 5) if step * power <= wanted)))


def _placed(volume: Volume) -> dict[str, object]:
    """Where the voxels of a volume are."""
    return {"scale": (volume.voxel_size,) * 3, "translate": tuple(volume.origin[::-1].tolist()), **SPACE}
