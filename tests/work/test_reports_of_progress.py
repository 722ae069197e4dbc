"""How much is done between two reports of progress, by each command: counted, not timed.

Each row is a function of the package that works on one part of something that grows with the data, and how often it may
be called between two reports.  `SAMPLES` bounds what one call of a kernel may do.
"""

import shutil
from collections import Counter
from contextlib import contextmanager
from importlib import import_module
from unittest import mock

import numpy as np
import pytest
from typer.testing import CliRunner

from grainmotion.cli.app import app
from grainmotion.model import progress
from grainmotion.projection import volume_operator
from tiny_experiment import VIEWS, write_tiny

PARTS = {
    "io.stacks:_read": 2,  # files; flats and darks are two
    "preprocessing.masked_pixels:spikes": 1,  # radiographs
    "reconstruction.slabs:advance": 1,  # slabs in an update
    "kernels.volume_projection:forward": 2,  # calls of kernels
    "kernels.volume_projection:adjoint": 2,
    "kernels.volume_projection_vertical:forward": 2,
    "kernels.volume_projection_vertical:adjoint": 2,
    "segmentation.grain_cutting:cut_grain": 1,  # grains
    "diagnosis.view_consistency:fitted_volume": 1,  # trial reconstructions
    "calibration.cross_validation:fitted_volume": 1,
    "tracking.alternative_fits:_fit": 1,  # batches of grains
    "analysis.grain_mesh:marching_cubes": 3,  # both grains of a pair
    "workflow.exports:display_mesh": 1,
    "kernels.resample:add_moved_label": 1,
    "report.radiographs:_encoded_view": 1,
    "report.surfaces:_surface": 1,
    "mechanics.contacts:_closest": 1,
    "io.dem_folder:_write_shapes": 1,
    "kernels.mesh_projection:transmission": 1,
    "workflow.dataset:write_tiff": 1,
    "simulate.voxelise:inside": 1,
}
"""Parts of the work, and the most of them between two reports."""


class Watch:
    """Calls of the functions of `PARTS` since the last report."""

    def __init__(self):
        self.since, self.most, self.calls = Counter(), Counter(), Counter()

    def report(self, *_):
        self.since.clear()

    def counting(self, name, function):
        def counted(*args, **kwargs):
            if progress._PART.get() is None:  # outside of a command, as where a test writes its files
                return function(*args, **kwargs)
            self.since[name] += 1
            self.calls[name] += 1
            self.most[name] = max(self.most[name], self.since[name])
            return function(*args, **kwargs)

        return counted


@contextmanager
def watched(monkeypatch):
    watch = Watch()
    with monkeypatch.context() as patch:
        patch.setattr(progress, "MIN_INTERVAL", 0.0)
        patch.setattr("numba.get_num_threads", lambda: 1)  # more threads do one each at a time
        call = progress.Listener.inside

        def inside(listener, share):
            watch.report()
            call(listener, share)

        step = progress.Listener.__call__

        def begin(listener, *report):
            watch.report()
            step(listener, *report)

        patch.setattr(progress.Listener, "inside", inside)
        patch.setattr(progress.Listener, "__call__", begin)
        for place in PARTS:
            module, name = place.split(":")
            module = import_module(f"grainmotion.{module}")
            patch.setattr(module, name, watch.counting(place, getattr(module, name)))
        yield watch


@pytest.fixture
def watch(monkeypatch):
    with watched(monkeypatch) as watch:
        yield watch


def invoke(*words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code in (0, 3), result.output
    return result


def assert_often_enough(watch, *called):
    assert {place for place in PARTS if watch.most[place] > PARTS[place]} == set(), watch.most
    assert set(called) <= set(watch.calls), watch.calls


@pytest.fixture(scope="module")
def tracked(tmp_path_factory):
    """A tiny experiment whose states are tracked."""
    path = write_tiny(tmp_path_factory.mktemp("progress"))
    invoke("track", path)
    return path


def test_reconstruct_and_calibrate(tmp_path, watch):
    path = write_tiny(tmp_path)
    path.write_text(path.read_text() + '\n[calibrate]\ngeometry = ["shift_u"]\nhardening = 2\n')
    invoke("reconstruct", path)
    assert_often_enough(
        watch, "io.stacks:_read", "preprocessing.masked_pixels:spikes", "reconstruction.slabs:advance",
        "calibration.cross_validation:fitted_volume", "kernels.volume_projection_vertical:forward",
    )  # fmt: skip
    assert watch.calls["io.stacks:_read"] >= VIEWS


def test_segment_and_track(tmp_path, watch):
    invoke("track", write_tiny(tmp_path))
    assert_often_enough(watch, "segmentation.grain_cutting:cut_grain")


def test_exports_and_report(tracked, tmp_path, watch):
    shutil.copytree(tracked.parent, tmp_path / "copy")
    path = tmp_path / "copy" / tracked.name
    formats = [word for name in ("vtk", "tiff", "spam", "mechanics", "dem") for word in ("--format", name)]
    invoke("export", path, *formats)
    assert_often_enough(
        watch, "analysis.grain_mesh:marching_cubes", "kernels.resample:add_moved_label", "report.surfaces:_surface",
        "report.radiographs:_encoded_view", "mechanics.contacts:_closest",
    )  # fmt: skip


def test_inspect_and_plan(tracked, watch):
    invoke("inspect", tracked)
    assert_often_enough(watch, "io.stacks:_read", "calibration.cross_validation:fitted_volume")


def test_simulate(tmp_path, watch):
    invoke("simulate", tmp_path / "new")
    assert_often_enough(watch, "kernels.mesh_projection:transmission", "workflow.dataset:write_tiff")


def test_a_call_of_a_projector_takes_few_views(monkeypatch):
    """However many radiographs there are: Python looks at signals between calls."""
    operator = volume_operator.VolumeOperator.__new__(volume_operator.VolumeOperator)
    geometry, grid = mock.Mock(shape=(1000, 1000)), mock.Mock(shape=(160, 1000, 1000))
    object.__setattr__(operator, "geometry", geometry)
    object.__setattr__(operator, "grid", grid)
    operator.__dict__["upright"] = False
    parts = list(operator._parts(50))
    assert all(part.stop - part.start == 1 for part in parts)
    assert [part.start for part in parts] == list(range(50))
    geometry.shape = (100, 100)
    grid.shape = np.array([100, 100, 100])
    assert len(list(operator._parts(1000))) == 1
