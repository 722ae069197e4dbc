"""Public functions that get an array, a file name or another record in place of a record say how to make it."""

import dataclasses

import numpy as np
import pytest

import grainmotion as gm

GEOMETRY = gm.Geometry.parallel([0, 30, 60, 90], (10, 10), 0.1)
ARRAY = np.ones((4, 10, 10), np.float32)
SCAN = gm.Scan(ARRAY, GEOMETRY)
VOLUME = gm.Volume(np.ones((8, 8, 8)), 0.1)

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
}


@pytest.mark.parametrize("kind", WRONG)
def test_plain_values_for_records_are_refused(kind):
    call, message = WRONG[kind]
    with pytest.raises(gm.InputError, match=message):
        call()


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
