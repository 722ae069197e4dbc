"""A stage that moves and a beam that drifts during the scan, both recorded in NXtomo files: motions and the truth."""

import numpy as np
import pytest

from grainmotion.analysis.validation import compare
from grainmotion.calibration.settings import ReferenceSettings, ScannerSettings
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_tables import Circular, ReferenceTable, ScanTable
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import scenarios
from grainmotion.simulate.detector import record_line_integrals
from grainmotion.simulate.sample import Sample
from grainmotion.tracking.track import track
from grainmotion.workflow.reference import Reference
from nxtomo_writer import write_nxtomo

VIEWS = 60
ANGLES, LATER = np.arange(VIEWS) * 360 / VIEWS, np.array([0.0, 45.0, 90.0, 135.0])
BEAM = 1 + 0.1 * np.cos(np.arange(VIEWS))


@pytest.fixture(scope="module")
def case():
    return scenarios.small()


def shadows(case, sample, angles, places, seed):
    """Radiographs of a sample that the stage carries to another place, lab frame, mm, in each view."""
    images = []
    for k, (angle, place) in enumerate(zip(angles, places, strict=True)):
        turn = rotation_matrix(np.deg2rad(angle) * np.array([0.0, 0.0, 1.0]))
        moved = Sample(tuple(p.moved(np.eye(3), turn @ place) for p in sample.particles))
        views = case.scanner.geometry((float(angle),))
        images.append(record_line_integrals(moved, views, case.physics, seed + k).line_integrals[0])
    return np.stack(images)


@pytest.fixture(scope="module")
def folder(case, tmp_path_factory):
    """The stage rises by 4 voxels and moves aside by 2 during the reference, and is elsewhere in the later state."""
    folder, voxel = tmp_path_factory.mktemp("nxtomo"), case.scanner.voxel_size
    start = np.array([3.0, -1.0, 12.0])
    path = voxel * np.stack([2 * np.sin(np.arange(VIEWS) / 9), np.zeros(VIEWS), np.linspace(0, 4, VIEWS)], axis=1)
    later = voxel * np.tile([1.5, 0.0, -2.5], (len(LATER), 1))
    state = case.sample.moved(case.motions["random"])
    for name, sample, angles, places in (("full", case.sample, ANGLES, path), ("later", state, LATER, later)):
        records = {f"sample/{a}_translation": (1e-3 * (start + places)[:, k], "m") for k, a in enumerate("xyz")}
        if name == "full":
            records["control/data"] = (BEAM, "")
        write_nxtomo(folder / f"{name}.nxs", shadows(case, sample, angles, places, len(angles)), angles, records)
    return folder


def compared(case, folder, motors):
    """Motions of the grains against the truth, and the findings about the reference."""
    scanner = case.scanner
    circle = Circular(
        beam="cone", pixel_size=scanner.pixel_size, source_to_axis=scanner.source_to_axis,
        source_to_detector=scanner.source_to_detector, first_row="top",
    )  # fmt: skip
    told = ReferenceTable(radiographs=["full.nxs"], geometry=circle, motors=motors)
    full = find_scan("reference", told, told, folder)
    later = find_scan("states.later", ScanTable(radiographs=["later.nxs"]), told, folder).read()[0]
    settings = ReferenceSettings(calibrate=ScannerSettings(geometry=False))
    reference = Reference.from_scan(full.read()[0], scanner.grid, settings)
    motions = track(reference.grains, reference.correct(later))
    return compare(motions, case.motions["random"], scanner.voxel_size), full.findings


def test_motions_are_those_of_a_stage_at_rest_and_a_constant_beam(case, folder):
    result, findings = compared(case, folder, None)
    assert not result.failed.any()
    assert np.sqrt(np.mean(result.translation_errors**2)) < 0.02 * case.scanner.voxel_size
    assert np.sqrt(np.mean(result.rotation_errors_deg**2)) < 0.3
    assert {f.check for f in findings} == {"motors", "monitor"}


@pytest.mark.slow
@pytest.mark.parametrize("motors", [("x", "y", "-z"), ("-x", "y", "z"), False])
def test_another_sign_fails(case, folder, motors):
    result, _ = compared(case, folder, motors)
    assert result.failed.any() or np.abs(result.translation_errors).max() > 0.5 * case.scanner.voxel_size
