"""The library gives the same results as the command, bit by bit, and the example of its docstring runs."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

import grainmotion as gm
from grainmotion.io.results import read_motions_h5, read_reference
from tiny_experiment import TOML, write_tiny

PROGRAM = """
import atexit, json, sys
from grainmotion.__main__ import main

def signatures():
    modules = [m for name, m in sys.modules.items() if name.startswith("grainmotion.kernels.")]
    kernels = {f"{k.py_func.__module__}.{n}": k for m in modules for n, k in vars(m).items() if hasattr(k, "py_func")}
    print(json.dumps({name: [str(s) for s in k.signatures] for name, k in kernels.items()}))

atexit.register(signatures)
main()
"""
LAYOUT = re.compile(r"readonly |(?<=[1-9]d, )[CFA](?=\))|(?<=, )'[CFA]', (True|False)")
"""What the types of arrays with the same numbers can differ in: their layout, and whether they can be written."""
WITHOUT_CALIBRATION = TOML.replace("[reconstruct]", "[calibrate]\ngeometry = false\n\n[reconstruct]")
WITH_CALIBRATION = TOML.replace("[reconstruct]", '[calibrate]\ngeometry = ["shift_u"]\nhardening = 2\n\n[reconstruct]')
OTHER_SEGMENTATION = 'threshold = 0.5\nreach = 1.0\nfiner = 1\nbackground = "moving"'
CASES = {
    "plain": WITHOUT_CALIBRATION,
    "calibrated": WITH_CALIBRATION.replace("pixel_size = 0.4\n", "pixel_size = 0.4\ndetector_offset = [-0.2, 0.0]\n"),
    "segmented otherwise": WITHOUT_CALIBRATION.replace("threshold = 0.5", OTHER_SEGMENTATION),
}


def by_library(folder, settings):
    """Reference and motions of both states by the calls that README shows."""
    beam = {"flats": folder / "flats.tif", "darks": folder / "darks.tif"}
    scan = gm.read_scan(folder / "reference" / "*.tif", folder / "reference.csv", **beam)
    reference = gm.Reference.from_scan(scan, gm.Volume.zeros((28, 36, 36), 0.1), settings.reference_settings)
    motions = [None]
    for name, table in zip(("one", "two"), settings.tables.states, strict=True):
        state = gm.read_scan(folder / table.radiographs[0], folder / f"{name}.csv", **beam)
        initial, track_settings = motions[-1], settings.tables.track
        if initial is not None:  # the second state: the better of the first state and of its extrapolation
            initial = initial, gm.extrapolate(None, initial)
        motions.append(gm.track(reference.grains, reference.correct(state), initial, track_settings))
    return reference, motions[1:]


def assert_equal_motions(one, other):
    for name in ("labels", "centers", "translations", "rotations", "covariances", "residuals", "statuses"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert one.reasons == other.reasons
    assert one.fit.costs == other.fit.costs


def assert_compiled_once(signatures):
    """No kernel was compiled once more, which takes seconds, because of the layout of an array."""
    assert len([s for s in signatures.values() if s]) > 10
    for name, each in signatures.items():
        kinds = {LAYOUT.sub("", signature) for signature in each}
        assert len(kinds) == len(each), f"{name} has different arrays: {each}"


@pytest.mark.parametrize("case", [pytest.param("plain", marks=pytest.mark.slow), "calibrated", "segmented otherwise"])
def test_library_and_command_give_the_same_bits(tmp_path, case):
    path = write_tiny(tmp_path, CASES[case])
    settings = gm.read_experiment(path)
    from grainmotion.experiment.inputs import find_inputs
    from grainmotion.io.geometry_csv import write_geometry

    write_geometry(tmp_path / "two.csv", find_inputs(settings).states[1].geometry)
    command = [sys.executable, "-c", PROGRAM, "run", path, "--quiet"]
    signatures = json.loads(subprocess.check_output(command, text=True).splitlines()[-1])
    reference, motions = by_library(tmp_path, settings)
    stored = read_reference(tmp_path / "results" / "reference.h5")
    np.testing.assert_array_equal(reference.volume.array, stored.volume.array)
    np.testing.assert_array_equal(reference.segmentation.labels, stored.labels)
    assert (reference.segmentation.border, reference.residuals) == (stored.border, stored.residuals)
    assert (reference.scanner.calibration is None) == (case != "calibrated")
    for name, motions_of_state in zip(("one", "two"), motions, strict=True):
        assert_equal_motions(read_motions_h5(tmp_path / "results" / name / "motions.h5"), motions_of_state)
    assert_compiled_once(signatures)


def test_given_labels_replace_the_segmentation(tmp_path):
    settings = gm.read_experiment(write_tiny(tmp_path, WITHOUT_CALIBRATION)).reference_settings
    beam = {"flats": tmp_path / "flats.tif", "darks": tmp_path / "darks.tif"}
    scan = gm.read_scan(tmp_path / "reference" / "*.tif", tmp_path / "reference.csv", **beam)
    grid, messages = gm.Volume.zeros((28, 36, 36), 0.1), []
    first = gm.Reference.from_scan(scan, grid, settings)
    labels = first.segmentation.labels.astype(np.int64)
    again = gm.Reference.from_scan(scan, grid, settings, labels=labels, progress=lambda *m: messages.append(m[0]))
    np.testing.assert_array_equal(again.grains.centers, first.grains.centers)
    assert np.isnan(again.segmentation.threshold)
    assert {message.split(":")[0] for message in messages} == {"reconstruct"}


def test_the_example_of_the_docstring_runs(tmp_path, monkeypatch):
    """Run it on the files of the tiny experiment, renamed as the example names them."""
    code = re.sub("(?m)^    ", "", gm.__doc__.split("::\n", 1)[1])
    assert len(code.strip().splitlines()) <= 10
    write_tiny(tmp_path)
    for name, folder in (("flats", "flats"), ("darks", "darks"), ("one", "step-01")):
        (tmp_path / folder).mkdir()
        (tmp_path / f"{name}.tif").rename(tmp_path / folder / f"{name}.tif")
    (tmp_path / "one.csv").rename(tmp_path / "step-01.csv")
    monkeypatch.chdir(tmp_path)
    names = {}
    exec(code.replace("(280, 180, 180), voxel_size=0.112", "(28, 36, 36), voxel_size=0.1"), names)
    assert len(names["motions"]) == 3
    assert len(names["motions"].to_table()) == 3
