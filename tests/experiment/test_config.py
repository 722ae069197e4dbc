"""Reading experiment files: paths, settings of the stages, and values that states inherit."""

import numpy as np
import pytest
from experiment_inputs import inputs_of

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from tiny_experiment import TOML, VIEWS, geometry, write_tiny


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("tiny")).parent


def test_paths_are_relative_to_the_experiment_file(tiny):
    experiment = read_experiment(tiny / "experiment.toml")
    assert experiment.output == tiny / "results"
    inputs = find_inputs(experiment)
    assert inputs.reference is not None
    assert len(inputs.reference.files) == VIEWS + 2
    assert inputs.grid.shape == (28, 36, 36)


def test_tables_of_stages_become_their_settings(tiny):
    tables = read_experiment(tiny / "experiment.toml").tables
    assert tables.reconstruct.sweeps == 3
    assert tables.track.search is False
    assert tables.segment.threshold == 0.5


def test_outline_of_the_volume_is_that_of_the_reconstruction(tiny):
    assert read_experiment(tiny / "experiment.toml").tables.reconstruct.outline == "auto"
    for value, expected in (("1.5", 1.5), ('"grid"', "grid"), ('"auto"', "auto")):
        (tiny / "outline.toml").write_text(TOML.replace("[volume]", f"[volume]\noutline = {value}"))
        tables = read_experiment(tiny / "outline.toml").tables
        assert (tables.reconstruct.outline, tables.reconstruct.sweeps) == (expected, 3)
    (tiny / "outline.toml").write_text(TOML.replace("[volume]", "[volume]\noutline = -1"))
    with pytest.raises(InputError, match="outline"):
        read_experiment(tiny / "outline.toml")


def test_states_inherit_flats_darks_kind_and_beam(tiny):
    states = find_inputs(read_experiment(tiny / "experiment.toml")).states
    for state in states:
        assert state.kind == "counts"
        assert state.geometry.beam == "cone"
        assert state.flats is not None
        assert state.flats.files == (tiny / "flats.tif",)
    np.testing.assert_allclose(states[1].geometry.vectors, geometry([10.0, 55.0, 100.0]).vectors)


def test_state_of_transmission_images_needs_no_flats(tiny):
    toml = TOML.replace('radiographs = "one.tif"', 'radiographs = "one.tif"\nkind = "transmission"')
    state = inputs_of(tiny, toml).states[0]
    assert (state.kind, state.flats) == ("transmission", None)


def test_byte_order_mark_and_ends_of_windows(tmp_path):
    path = write_tiny(tmp_path)
    text = path.read_text()
    path.write_bytes(("\ufeff" + text.replace("\n", "\r\n")).encode())
    assert read_experiment(path).tables == read_experiment(write_tiny(tmp_path / "plain")).tables


def test_other_encodings_and_backslashes_are_named(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text("[reference]\n", encoding="utf-16")
    with pytest.raises(InputError, match="UTF-16; save it as UTF-8"):
        read_experiment(path)
    path.write_bytes("[reference]\n# Größe\n".encode("latin-1"))
    with pytest.raises(InputError, match="line 2 is no UTF-8"):
        read_experiment(path)
    path.write_text('[reference]\nradiographs = "C:\\data\\*.tif"\n')
    with pytest.raises(InputError, match="write paths with / instead of"):
        read_experiment(path)
