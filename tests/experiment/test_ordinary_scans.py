"""Scans as beamlines and laboratories take them: right geometry through the experiment file, and no false alarm.

Golden-ratio, interlaced, half and multiple turns, return projections, shifts of single views, a beam that fluctuates.
"""

import numpy as np
import pytest
import tifffile

from grainmotion.diagnosis.scan_geometry import check_scan
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.model.finding import Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from lab_scanner import Lab
from nxtomo_writer import write_nxtomo
from read_experiment_scan import misfit, reference_of

VIEWS = 60
GOLDEN = 180 * (np.sqrt(5) - 1)  # 222.5 degrees
ORDERS = {
    "golden ratio": np.arange(VIEWS) * GOLDEN,
    "golden ratio, wrapped": np.arange(VIEWS) * GOLDEN % 360,
    "interlaced": np.concatenate([np.arange(k, VIEWS, 4) for k in (0, 2, 1, 3)]) * 360 / VIEWS,
    "two turns, interlaced": np.arange(VIEWS) * 12.0 + np.repeat([0.0, 6.0], VIEWS // 2),
    "three turns": np.arange(VIEWS) * 18.0 + np.arange(VIEWS) // 20 * 6,
    "backwards": 360 - np.arange(VIEWS) * 6.0,
    "returns at the end": np.r_[np.arange(VIEWS - 3) * 360 / (VIEWS - 3), 270.0, 180.0, 90.0],
}
HALF_TURNS = {
    "half a turn": np.arange(VIEWS) * 3.0,
    "half a turn, end counted": np.linspace(-90, 90, VIEWS),
    "half a turn, returns": np.r_[np.linspace(0, 180, VIEWS - 3), 120.0, 60.0, 0.0],
}
CONE, PARALLEL = Lab(), Lab(parallel=True, pixel=0.15)
SAME = 2e-3


def toml(lab, extra=""):
    beam = 'beam = "parallel"\n' if lab.parallel else "source_to_axis = 60\nsource_to_detector = 240\n"
    return f'[reference.geometry]\npixel_size = {lab.pixel}\nfirst_row = "top"\n{beam}{extra}'


def alarms(source):
    return [str(f) for f in source.findings if f.level is not Level.NOTE]


def checked(source):
    """What the check of the whole scan finds, on a grid that holds the object."""
    scan = source.read()[0]
    found = check_scan(
        scan, Volume(np.zeros((56, 64, 64), np.float32), 0.1 if source.geometry.beam == "cone" else 0.15)
    )
    return [str(f) for f in found if f.level is not Level.NOTE]


@pytest.mark.parametrize("name", [*ORDERS, *HALF_TURNS])
class TestOrders:
    def source(self, tmp_path, name):
        angles = {**ORDERS, **HALF_TURNS}[name]
        lab = PARALLEL if name in HALF_TURNS else CONE
        for k, image in enumerate(lab.images(-angles)):
            tifffile.imwrite(tmp_path / f"p_{k}.tif", image.astype(np.float32))
        np.savetxt(tmp_path / "angles.txt", angles)
        head = '[reference]\nradiographs = "p_*.tif"\nkind = "line-integrals"\n'
        return reference_of(tmp_path, head + toml(lab, 'angles_deg = "angles.txt"\n'))

    def test_the_geometry_is_right(self, tmp_path, name):
        assert misfit(self.source(tmp_path, name)) < 1e-4

    def test_names_and_angles_give_no_alarm(self, tmp_path, name):
        assert alarms(self.source(tmp_path, name)) == []

    def test_the_views_give_no_alarm(self, tmp_path, name):
        assert checked(self.source(tmp_path, name)) == []


def test_shifts_of_single_views(tmp_path):
    """A sample that is carried about by the stage, 3 pixels to both sides, as a table of views tells it."""
    angles, rng = ORDERS["interlaced"], np.random.default_rng(3)
    shifts = rng.uniform(-3, 3, (VIEWS, 2)) * CONE.pixel
    images = [Lab(panel_shift=tuple(s)).image(-a) for s, a in zip(shifts, angles, strict=True)]
    np.save(tmp_path / "images.npy", np.stack(images))
    views = Geometry.cone(angles, CONE.shape, CONE.pixel, source_to_axis=60, source_to_detector=240)
    vectors = views.vectors.copy()
    vectors[:, 3:6] += shifts @ [[1], [0]] * views.u / CONE.pixel + shifts @ [[0], [1]] * views.v / CONE.pixel
    vectors[:, 9:] *= -1
    write_geometry(tmp_path / "views.csv", Geometry(vectors, CONE.shape))
    head = '[reference]\nradiographs = "images.npy"\nkind = "line-integrals"\ngeometry = "views.csv"\n'
    source = reference_of(tmp_path, head)
    assert misfit(source) < 1e-6
    assert alarms(source) == []
    assert checked(source) == []


@pytest.mark.parametrize("name", ["golden ratio", "two turns, interlaced"])
def test_a_beam_that_fluctuates_with_a_monitor(tmp_path, name):
    """Counts of each frame follow the beam, and the file's monitor tells it; rows of these files run from the top."""
    angles = ORDERS[name]
    beam = 1 + 0.1 * np.random.default_rng(4).standard_normal(VIEWS)
    write_nxtomo(tmp_path / "scan.nxs", CONE.images(-angles)[:, ::-1], angles, {"control/data": (beam, "")})
    source = reference_of(tmp_path, '[reference]\nradiographs = "scan.nxs"\n' + toml(CONE))
    assert misfit(source) < SAME
    assert alarms(source) == []
    assert checked(source) == []


def test_a_beam_that_fluctuates_seen_beside_the_sample(tmp_path):
    angles = ORDERS["golden ratio"]
    beam = 1 + 0.1 * np.random.default_rng(4).standard_normal(VIEWS)
    counts = np.round(40_000 * beam[:, None, None] * np.exp(-CONE.images(-angles))).astype(np.uint16)
    np.save(tmp_path / "counts.npy", counts)
    np.save(tmp_path / "flats.npy", np.full((2, *CONE.shape), 40_000, np.uint16))
    np.savetxt(tmp_path / "angles.txt", angles)
    head = '[reference]\nradiographs = "counts.npy"\nflats = "flats.npy"\nair = { margin = 3 }\n'
    source = reference_of(tmp_path, head + toml(CONE, 'angles_deg = "angles.txt"\n'))
    assert misfit(source) < SAME
    assert alarms(source) == []
    assert checked(source) == []
