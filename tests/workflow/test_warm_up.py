"""The rehearsal of a watch runs for any panel and any number of grains, and hands nothing on."""

import pytest

from few_grains import VOXEL, grain_set
from grainmotion.experiment.inputs import Inputs
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.io.stacks import Stack
from grainmotion.model.geometry import Geometry
from grainmotion.model.volume import Volume
from grainmotion.tracking.track import TrackSettings
from grainmotion.workflow import warm_up

GRID = Volume.zeros((46, 44, 52), VOXEL)
QUICK = TrackSettings(search=False, iterations=1)


def inputs(shape=None):
    """Inputs with a reference scan of so many rows and columns, or with a given volume alone."""
    if shape is None:
        return Inputs(None, (), (), GRID, Stack("volume.tif", ()))
    pixel = 4 * VOXEL * 64 / max(shape)
    views = Geometry.cone(range(0, 360, 6), shape, pixel, source_to_axis=40, source_to_detector=160)
    return Inputs(ScanInput("reference", Stack("scan", ()), None, None, "transmission", views), (), (), GRID)


@pytest.mark.parametrize("shape", [None, (52, 64), (308, 268), (129, 131), (5, 300)])
def test_any_panel(shape, monkeypatch):
    tracked = []
    original = warm_up.track

    def track(grains, scan, *arguments, **options):
        tracked.append(scan.geometry)
        return original(grains, scan, *arguments, **options)

    monkeypatch.setattr(warm_up, "track", track)
    warm_up.warm_up(grain_set(2, finer=1), inputs(shape), QUICK, None)
    (geometry,) = tracked
    assert len(geometry) == warm_up.WARM_UP_VIEWS
    assert max(geometry.shape) <= warm_up.WARM_UP_PIXELS


def test_few_of_many_grains_are_used(monkeypatch):
    counts = []
    monkeypatch.setattr(warm_up, "track", lambda grains, *arguments, **options: counts.append(len(grains)))
    monkeypatch.setattr(warm_up, "WARM_UP_GRAINS", 3)
    warm_up.warm_up(grain_set(5, finer=1), inputs(), QUICK, None)
    warm_up.warm_up(grain_set(2, finer=1), inputs(), QUICK, None)
    assert counts == [3, 2]
