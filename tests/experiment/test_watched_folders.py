"""Folders as states: their order, the files that their table names, and keys that they have from the reference."""

import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment

HEAD = """
[reference]
radiographs = "reference/*.tif"
flats = "flats.tif"
[reference.geometry]
beam = "cone"
source_to_axis = 50
source_to_detector = 200
pixel_size = 0.4
first_row = "bottom"
count = 40
first = 0
last = 351
"""


def states(folder, table, *names):
    for name in names:
        (folder / name).mkdir(parents=True)
    (folder / "experiment.toml").write_text(HEAD + table)
    return read_experiment(folder / "experiment.toml").tables.states


def test_folders_are_in_the_order_of_their_numbers(tmp_path):
    names = [f"steps/load-{k}" for k in (10, 9, 100)]
    found = states(tmp_path, '[watch]\nfolders = "steps/*"\ngeometry = "a.csv"\n', *names, "steps/.hidden")
    assert [state.name for state in found] == ["load-9", "load-10", "load-100"]
    assert found[0].radiographs == [(tmp_path / "steps/load-9").as_posix()]


def test_a_table_has_the_circle_of_the_reference(tmp_path):
    (state,) = states(tmp_path, '[watch]\nfolders = "s*"\n[watch.geometry]\nangles_deg = "{folder}/angles.txt"\n', "s1")
    assert state.geometry.pixel_size == 0.4
    assert state.geometry.angles_deg == (tmp_path / "s1/angles.txt").as_posix()
    assert state.geometry.count is None


def test_the_folder_stands_in_all_names_of_files(tmp_path):
    table = '[watch]\nfolders = "s*"\nradiographs = "{folder}/p*.tif"\nflats = "{folder}/flat.tif"\ndarks = "d.tif"\n'
    (state,) = states(tmp_path, table + 'geometry = "{folder}/g.csv"\n', "s1")
    folder = (tmp_path / "s1").as_posix()
    assert state.radiographs == [f"{folder}/p*.tif"]
    assert (state.flats, state.darks) == ([f"{folder}/flat.tif"], ["d.tif"])
    assert state.geometry == f"{folder}/g.csv"


def test_folders_within_the_results_are_left_out(tmp_path):
    found = states(tmp_path, '[watch]\nfolders = "*/s*"\ngeometry = "a.csv"\n', "results/s1", "steps/s2")
    assert [state.name for state in found] == ["s2"]


@pytest.mark.parametrize(
    ("table", "name", "message"),
    [
        ('folders = ""', "b/1", "no pattern"),
        ('folders = "steps/*"\ncount = 0', "steps/1", "watch.count"),
        ('folders = "steps/*"\ngeometri = "a.csv"', "steps/1", "watch.geometri: unknown key"),
    ],
)
def test_what_cannot_be_is_named(tmp_path, table, name, message):
    with pytest.raises(InputError, match=message):
        states(tmp_path, f"[watch]\n{table}\n", "a/1", name)


@pytest.mark.parametrize(
    ("pattern", "name", "message"),
    [
        ("steps/*", "steps/_1", "_1 cannot be a state: it names a folder"),
        ("steps/*", "steps/series.h5", "a result file has this name"),
        ("*/1", "b/1", "a state is called '1' already"),
    ],
)
def test_a_folder_that_cannot_be_a_state_is_left_out_with_the_reason(tmp_path, pattern, name, message):
    path = tmp_path / "experiment.toml"
    path.write_text(f'{HEAD}[watch]\nfolders = "{pattern}"\ngeometry = "a.csv"\n')
    for folder in ("steps/1", name):
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    experiment = read_experiment(path)
    assert len(experiment.tables.states) == 1
    assert [message in sentence for sentence in experiment.left_out] == [True]
