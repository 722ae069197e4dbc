"""The predefined cases (`simulate.scenarios`), and experiments written from them."""

import tomllib

import numpy as np
import pandas as pd
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.model.geometry import VIEW_COLUMNS
from grainmotion.model.motions import Motions
from grainmotion.preprocessing.flat_field import line_integrals_from_counts
from grainmotion.simulate import LATER_ANGLES_DEG, gaps, small
from grainmotion.workflow.dataset import write_dataset


def test_small_case_has_six_touching_grains_of_twenty_voxels(case):
    voxel = case.scanner.voxel_size
    assert len(case.sample) == 6
    diameters = [np.cbrt(6 / np.pi * p.shape.volume) / voxel for p in case.sample.particles]
    assert 18 < min(diameters) < max(diameters) < 22
    distances = gaps(case.sample)
    assert distances.min() > 0
    assert ((distances < 0.5 * voxel).sum(axis=1) >= 1).all()


def test_stones_are_the_same_with_and_without_inclusions():
    plain, filled = small(seed=3), small(seed=3, inclusion=1.5)
    for a, b in zip(plain.sample.particles, filled.sample.particles, strict=True):
        assert np.array_equal(a.shape.vertices, b.shape.vertices)
        ((_, value),) = b.inclusions
        assert value == pytest.approx(1.5 * a.attenuation)
        assert 1.001 < b.mass / a.mass < 1.1


@pytest.mark.parametrize("name", ["unmoved", "shift", "random"])
def test_every_motion_stays_in_the_field_of_view(case, name):
    scan = case.state(case.motions[name], LATER_ANGLES_DEG[4])
    border = np.concatenate([scan.line_integrals[:, [0, -1]].ravel(), scan.line_integrals[:, :, [0, -1]].ravel()])
    assert np.abs(border).max() < 6 / np.sqrt(case.physics.photons)  # noise alone
    assert scan.line_integrals.max() > 0.3


def test_random_motion_is_within_five_voxels_and_ten_degrees(case):
    motions = case.motions["random"]
    assert np.linalg.norm(motions.translations, axis=1).max() <= 5 * case.scanner.voxel_size
    assert np.rad2deg(np.linalg.norm(motions.rotations, axis=1)).max() <= 10


def test_dataset_is_an_experiment_with_true_motions(case, tmp_path):
    states = {
        name: (case.state_counts(case.motions[name], LATER_ANGLES_DEG[2]), case.motions[name])
        for name in ("shift", "random")
    }
    reference = case.state_counts(case.motions["unmoved"], (0.0, 90.0, 180.0), number=0)
    path = write_dataset(tmp_path, reference, states, case.scanner.grid)
    tables = tomllib.loads(path.read_text())
    assert [s["name"] for s in tables["states"]] == ["shift", "random"]
    assert tables["volume"]["shape"] == [96, 72, 72]
    assert pd.read_csv(tmp_path / "shift.csv").columns.tolist() == list(VIEW_COLUMNS)
    counts = np.stack([tifffile.imread(f) for f in sorted((tmp_path / "random").glob("*.tif"))])
    assert counts.dtype == np.uint16
    flats, darks = (
        np.stack([tifffile.imread(f) for f in sorted((tmp_path / name).glob("*.tif"))]) for name in ("flats", "darks")
    )
    scan, report = line_integrals_from_counts(counts, flats, darks, states["random"][0].geometry)
    assert report.bad == 0
    clean = case.state(case.motions["random"], LATER_ANGLES_DEG[2], number=7).line_integrals
    assert np.corrcoef(scan.line_integrals.ravel(), clean.ravel())[0, 1] > 0.99
    truth = Motions.from_table(pd.read_csv(tmp_path / "random-truth.csv"))
    assert np.allclose(truth.translations, case.motions["random"].translations)
    with pytest.raises(InputError, match="already holds files"):
        write_dataset(tmp_path, reference, states, case.scanner.grid)


def test_state_named_as_another_folder_is_refused(case, tmp_path):
    recording = case.state_counts(case.motions["unmoved"], (0.0,))
    with pytest.raises(InputError, match="name cannot be"):
        write_dataset(tmp_path, recording, {"flats": (recording, case.motions["unmoved"])}, case.scanner.grid)
