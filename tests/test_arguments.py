"""Public functions that get an array, a file name or another record in place of a record say how to make it."""

import dataclasses
import inspect
import re

import numpy as np
import pytest

import grainmotion as gm
from grainmotion.backends.device import backend_of

GEOMETRY = gm.Geometry.parallel([0, 30, 60, 90], (10, 10), 0.1)
ARRAY = np.ones((4, 10, 10), np.float32)
SCAN = gm.Scan(ARRAY, GEOMETRY)
VOLUME = gm.Volume(np.ones((8, 8, 8)), 0.1)
MOTIONS = gm.Motions.identity([1, 2, 3, 4, 5], np.random.default_rng(0).uniform(-1, 1, (5, 3)))
COUNTS = gm.Scan(20_000 * ARRAY, GEOMETRY)
SAMPLE = gm.simulate.Sample((gm.simulate.Particle(gm.simulate.sphere(1.0, 2), 0.1),))
SERIES = gm.Series.of({"step-01": MOTIONS})

WRONG = {
    "array for a scan": (lambda: gm.reconstruct(ARRAY, VOLUME), r"reconstruct\(scan\): got an array .*gm.Scan\("),
    "array for a grid": (lambda: gm.reconstruct(SCAN, ARRAY), r"reconstruct\(grid\).*gm.Volume.zeros"),
    "exchanged": (lambda: gm.track(SCAN, ARRAY), r"track\(grains\): got Scan, wants GrainSet"),
    "array for files": (lambda: gm.read_scan(ARRAY, GEOMETRY), r"read_scan\(radiographs\).*line_integrals_from_counts"),
    "arrays for files": (lambda: gm.read_scan([ARRAY[0], ARRAY[1]], GEOMETRY), r"read_scan\(radiographs\): got list"),
    "vectors": (lambda: gm.read_scan("a.tif", GEOMETRY.vectors), r"gm.Geometry\(vectors, shape, beam\)"),
    "vectors of a scan": (lambda: gm.Scan(ARRAY, GEOMETRY.vectors), r"Scan\(geometry\): got an array"),
    "array for a volume": (lambda: gm.segment(ARRAY), r"segment\(volume\).*gm.Volume\(array, voxel_size\)"),
    "volume for labels": (lambda: gm.grains_from_labels(VOLUME, VOLUME), "got Volume, wants an array; give its array"),
    "scan for images": (lambda: gm.back_project(SCAN, GEOMETRY, VOLUME), "give its line_integrals"),
    "file of an experiment": (lambda: gm.run("a.toml"), r"gm.read_experiment\("),
    "labels for a segmentation": (lambda: gm.extract_grains(VOLUME, np.ones((8, 8, 8), int)), "gm.grains_from_labels"),
    "table of settings": (lambda: gm.reconstruct(SCAN, VOLUME, {"sweeps": 3}), r"gm.ReconstructSettings\(key=value\)"),
    "settings by keyword": (lambda: gm.segment(VOLUME, settings={"threshold": 1}), r"gm.SegmentSettings\(key=value\)"),
    "array for motions": (lambda: gm.compare(ARRAY, ARRAY), r"gm.track\(grains, scan\)"),
    "scan of a reference": (lambda: gm.Reference.from_scan(ARRAY, VOLUME), r"from_scan\(scan\)"),
    "table for motions": (lambda: gm.plot.motions(MOTIONS.to_dataframe()), r"motions\(motions\): got DataFrame"),
    "reference for grains": (lambda: gm.contacts(GEOMETRY), r"contacts\(grains\): got Geometry, wants GrainSet"),
    "unknown object": (lambda: gm.segment(object()), r"segment\(volume\): got object, wants Volume"),
    "text for a number": (
        lambda: gm.strains(MOTIONS, reach="2"),
        r"strains\(reach\): got str '2', wants float; give a number",
    ),
    "fraction of a view": (lambda: gm.plot.radiograph(SCAN, 1.5), r"got float 1.5, wants int; give a whole number"),
    "text for yes or no": (lambda: gm.plot.grain_map(MOTIONS, moved="no"), "wants bool; give True or False"),
    "number for labels": (lambda: gm.plot.history(SERIES, labels=1), r"history\(labels\).*give a list of numbers"),
    "texts for numbers": (lambda: gm.plot.convergence(["a"]), r"convergence\(fit\): got list"),
    "list of states": (lambda: gm.Series.of([MOTIONS]), r"of\(motions\): got list.*dictionary"),
    "list of times": (lambda: gm.Series.of({"a": MOTIONS}, [60.0]), r"of\(times\): got list.*seconds"),
    "number for a file": (lambda: gm.read_motions(1), r"read_motions\(path\): got int 1, .*name of a file"),
    "case for a sample": (lambda: gm.simulate.unmoved(gm.simulate.HARD_CASES), r"unmoved\(sample\).*gm.simulate.small"),
    "one size of a panel": (lambda: gm.Geometry.parallel([0, 90], 96, 0.5), r"parallel\(shape\): got int 96"),
    "broken pixel": (lambda: gm.Geometry.parallel([0], (96.5, 72), 0.5), r"parallel\(shape\): got tuple"),
    "angles as a text": (lambda: gm.Geometry.parallel("0,90", (96, 72), 0.5), r"parallel\(angles_deg\): got str"),
    "text for a voxel": (lambda: gm.Volume(np.ones((2, 2, 2)), "0.1"), r"Volume\(voxel_size\): got str '0.1'"),
    "edges of a voxel": (lambda: gm.Volume(np.ones((2, 2, 2)), (0.1, 0.1, 0.1)), r"Volume\(voxel_size\): got tuple"),
    "broken voxels": (lambda: gm.Volume.zeros((4.0, 4, 4), 0.1), r"Volume.zeros\(shape\): got tuple, wants"),
    "negative voxels": (lambda: gm.Volume.zeros((-4, 4, 4), 0.1), r"Volume.zeros\(shape\): it is -4 × 4 × 4 voxels"),
    "images of other views": (
        lambda: gm.back_project(ARRAY[:2], GEOMETRY, VOLUME),
        r"images: shape \(2, 10, 10\), the",
    ),
    "unknown device": (lambda: backend_of("tpu"), r"device: 'tpu' is unknown; use auto, cpu, cuda"),
    "no function": (lambda: gm.segment(VOLUME, progress=True), r"segment\(progress\): got bool True, wants a function"),
    "negative threshold": (lambda: gm.SegmentSettings(threshold=-1), "SegmentSettings.threshold: .* greater than 0"),
    "negative filter": (
        lambda: gm.TrackSettings(filters=(6, -2)),
        "TrackSettings.filters: .* greater than or equal to 0",
    ),
    "counts for line integrals": (lambda: gm.Reference.from_scan(COUNTS, VOLUME), "line_integrals_from_counts"),
    "array to correct": (lambda: gm.ScannerCalibration().apply(ARRAY), r"apply\(scan\): got an array"),
    "two rows of a grain": (lambda: gm.Motions.identity([1, 1], np.zeros((2, 3))), "grain 1 is there twice"),
    "broken labels": (lambda: gm.Motions.identity([1.5, 2], np.zeros((2, 3))), "motions.labels: they are float64"),
    "labels of a file": (lambda: gm.write_labels("a.tif", np.ones((8, 8, 8)), VOLUME), "labels: they are float64"),
    "time of no state": (lambda: gm.Series.of({"a": MOTIONS}, {"b": 1.0}), "a time of 'b', which is no state"),
    "flat points": (lambda: gm.simulate.polyhedron(np.zeros((5, 3))), "its 5 points span no volume"),
    "ball without a size": (lambda: gm.simulate.sphere(-1.0), "diameter: must be > 0, got -1.0"),
    "disc upside down": (lambda: gm.simulate.disc(1.0, 2.0, 1.0), "disc: radius 1.0, from 2.0 to 1.0 mm"),
    "negative axis": (
        lambda: gm.simulate.Ellipsoid(np.zeros(3), np.array([1, -1, 1]), np.eye(3)),
        "ellipsoid: semi-axes",
    ),
    "gradient as a vector": (
        lambda: gm.simulate.affine(SAMPLE, np.ones(3)),
        r"affine motions: a gradient of shape \(3,\)",
    ),
    "axes in an array": (lambda: gm.plot.motions(MOTIONS, ax=np.array([None])), r"motions\(ax\).*axes\[0\]"),
}

ALLOWED = {
    "whole number for a number": lambda: gm.strains(MOTIONS, reach=2),
    "number of NumPy": lambda: gm.plot.radiograph(SCAN, np.int64(1)),
    "array without axes": lambda: gm.strains(MOTIONS, reach=np.float32(2)),
    "labels as an array": lambda: gm.plot.history(SERIES, labels=SERIES.labels),
    "residuals as an array": lambda: gm.plot.convergence(np.array([0.2, 0.1])),
    "labels as a list": lambda: gm.plot.volume_slice(VOLUME, np.ones((8, 8, 8), int).tolist()),
}


@pytest.mark.parametrize("kind", WRONG)
def test_plain_values_for_records_are_refused(kind):
    call, message = WRONG[kind]
    with pytest.raises(gm.InputError, match=message):
        call()


@pytest.mark.parametrize("kind", ALLOWED)
def test_like_values_are_taken(kind):
    ALLOWED[kind]()


FUNCTIONS = [
    function
    for module in (gm, gm.plot, gm.simulate)
    for function in (getattr(module, name) for name in dir(module) if not name.startswith("_"))
    if inspect.isfunction(function)
]
EMPTY = inspect.Parameter.empty


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: f"{function.__module__}.{function.__name__}")
def test_every_public_function_refuses_a_foreign_object(function):
    """Its first argument, of no known type, gets the package's own error, which names function and argument."""
    parameters = list(inspect.signature(function).parameters.values())
    needed = [p.name for p in parameters if p.default is EMPTY] or [parameters[0].name]
    with pytest.raises(gm.InputError, match=re.escape(f"{function.__name__}({needed[0]}): got object")):
        function(**dict.fromkeys(needed, object()))


def test_float_labels_are_refused():
    with pytest.raises(gm.InputError, match="labels: they are float64; give integers"):
        gm.grains_from_labels(VOLUME, np.ones((8, 8, 8)))


SETTINGS = [name for name in dir(gm) if name.endswith("Settings")]


def test_there_are_settings():
    assert len(SETTINGS) >= 6


@pytest.mark.parametrize("name", SETTINGS)
def test_unknown_settings_are_refused(name):
    with pytest.raises(gm.InputError, match=f"{name}.gainz: unknown setting; (did you mean|known settings are)"):
        getattr(gm, name)(gainz="view")
    known = dataclasses.fields(getattr(gm, name))[0].name
    near = known[:-1] + "q"
    with pytest.raises(gm.InputError, match=f"did you mean '{known}'"):
        getattr(gm, name)(**{near: 1})
