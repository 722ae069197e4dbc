"""Errors of experiment files: each names the key and a remedy; unknown keys are reported before wrong values."""

import pytest
from experiment_inputs import inputs_of

from grainmotion.errors import InputError
from tiny_experiment import TOML, write_tiny


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("tiny")).parent


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[volume]", "[volumes]", "volumes: unknown key; did you mean 'volume'?"),
        ("voxel_size", "voxelsize", "volume.voxelsize: unknown key; did you mean 'voxel_size'?"),
        ("sweeps = 3", "sweep = 3", "reconstruct.sweep: unknown key; did you mean 'sweeps'?"),
        ("search = false", "serach = false", "track.serach: unknown key; did you mean 'search'?"),
        ("threshold = 0.5", "treshold = 0.5", "segment.treshold: unknown key; did you mean 'threshold'?"),
        ('geometry = "one.csv"', 'geometri = "one.csv"', "states.one.geometri: unknown key"),
        ("pixel_size = 0.4", "pixelsize = 0.4", "states.two.geometry.pixelsize: unknown key"),
        ('name = "two"', 'naem = "two"', r"states\[2\].naem: unknown key; did you mean 'name'?"),
        ('name = "two"', "", r"states\[2\].name: it is missing"),
        ('name = "two"', 'name = "one"', "'one' is given twice"),
        ('name = "two"', 'name = "report.html"', "cannot be called"),
        ('name = "two"', 'name = "../two"', "states.../two.name"),
        ("sweeps = 3", "sweeps = 0", "reconstruct.sweeps.*got 0"),
        ("sweeps = 3", 'sweeps = "many"', "reconstruct.sweeps.*got 'many'"),
        ("shape = [28, 36, 36]", "shape = [28, 36]", "volume.shape"),
        ("shape = [28, 36, 36]", "shape = [28, 36, 0]", "volume.shape"),
        ("voxel_size = 0.1", "voxel_size = -0.1", "volume.voxel_size.*got -0.1"),
        ("pixel_size = 0.4", "", "states.two.geometry.pixel_size: it is missing"),
        ("pixel_size = 0.4", "pixel_size = 0", "states.two.geometry.pixel_size"),
        ("[10.0, 55.0, 100.0]", '[10.0, "x", 100.0]', r"states.two.geometry.angles_deg\[1\]"),
        ("source_to_axis = 50", "", "states.two.geometry.source_to_axis: it is missing"),
        ("source_to_axis = 50", "source_to_axis = 500", "states.two.geometry.source_to_axis"),
        ('beam = "cone"', 'beam = "fan"', "states.two.geometry.beam"),
        ("angles_deg = [10.0, 55.0, 100.0]", "", "states.two.geometry.angles_deg: it is missing"),
        ('flats = "flats.tif"', "", "reference.flats: it is missing"),
        ('geometry = "one.csv"', "", "states.one.geometry: it is missing"),
        ("[reference]", "[reference", "malformed TOML"),
    ],
)
def test_error_names_the_key(tiny, old, new, message):
    assert old in TOML
    with pytest.raises(InputError, match=message):
        inputs_of(tiny, TOML.replace(old, new, 1))


@pytest.mark.parametrize(("one", "two"), [("0", "5"), ("60", "60"), ("60", "30"), ("nan", "5"), ("inf", "inf")])
def test_times_of_states_increase_from_the_reference(tiny, one, two):
    toml = TOML.replace('name = "one"', f'name = "one"\ntime = {one}')
    toml = toml.replace('name = "two"', f'name = "two"\ntime = {two}')
    with pytest.raises(InputError, match=r"states.*\.time"):
        inputs_of(tiny, toml)


def test_several_errors_are_told_at_once(tiny):
    toml = TOML.replace("voxel_size = 0.1", "voxel_size = -0.1").replace("sweeps = 3", "sweep = 3")
    toml = toml.replace("pixel_size = 0.4", "").replace('first_row = "bottom"', "")
    with pytest.raises(InputError) as error:
        inputs_of(tiny, toml)
    lines = str(error.value).splitlines()
    assert len(lines) == 4
    assert "reconstruct.sweep: unknown key" in lines[0]  # first what is unknown, then what is missing, then values
    assert {"states.two.geometry.pixel_size:", "states.two.geometry.first_row:"} == {
        line.split()[1] for line in lines[1:3]
    }
    assert "also volume.voxel_size: input should be greater than 0, got -0.1; correct the value: mm" in lines[3]


def test_a_mistyped_key_is_not_reported_missing_as_well(tiny):
    with pytest.raises(InputError, match=r"frist_row: unknown key; did you mean 'first_row'\?$"):
        inputs_of(tiny, TOML.replace("first_row", "frist_row"))


@pytest.mark.parametrize("name", ["étape 1", "Belastung_ä 5%", "试样", "F=12,5 kN (2)", "étape 1 – 5 %"])
def test_states_have_names_in_any_alphabet(tiny, name):
    assert inputs_of(tiny, TOML.replace('name = "two"', f'name = "{name}"')).states[1].key == f"states.{name}"


def test_missing_reference_is_refused(tiny):
    with pytest.raises(InputError, match="reference: it is missing"):
        inputs_of(tiny, "[volume]\nvoxel_size = 0.1\n")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[10.0, 55.0, 100.0]", "{ first = 1, last = 2, cuont = 3 }", "angles_deg.cuont: unknown key; .* 'count'?"),
        ("[track]", "[calibrate]\nhardenin = 2\n[track]", "calibrate.hardenin: unknown key; did you mean 'hardening'?"),
        ("[volume]", "air = { margn = 3 }\n[volume]", "reference.air.margn: unknown key; did you mean 'margin'?"),
        ("[volume]", "zzz = 1\n[volume]", "reference.zzz: unknown key; known keys are radiographs, flats"),
        ("sweeps = 3", "sweeps = 0\nserach = 1", "reconstruct.serach: unknown key"),
        ("[reference]", "states = 3\n[reference]", "states: it is no list of tables"),
    ],
)
def test_unknown_keys_are_reported_first_with_the_nearest_known_key(tiny, old, new, message):
    toml = TOML.replace(old, new, 1)
    toml = toml if "states = 3" not in new else toml[: toml.index("[[states]]")]
    with pytest.raises(InputError, match=message):
        inputs_of(tiny, toml)


def test_states_without_a_reference_do_not_hide_that_it_is_missing(tiny):
    toml = TOML[TOML.index("[volume]") :].replace("pixel_size = 0.4", "")
    with pytest.raises(InputError, match=r"reference: it is missing; add this key$"):
        inputs_of(tiny, toml)


CIRCLE = """\
[reference]
radiographs = "reference/*.tif"
flats = "flats.tif"
[reference.geometry]
beam = "cone"
[volume]
shape = [28, 36, 36]
voxel_size = 0.1
"""


def missing_keys_of(tiny, toml):
    with pytest.raises(InputError) as error:
        inputs_of(tiny, toml)
    return [line.split(": it is missing")[0].split(".")[-1] for line in str(error.value).splitlines()]


def test_all_keys_that_the_circle_of_the_reference_lacks_are_told_at_once(tiny):
    everything = ["pixel_size", "first_row", "source_to_axis", "source_to_detector", "angles_deg"]
    assert missing_keys_of(tiny, CIRCLE) == everything
    assert missing_keys_of(tiny, CIRCLE.replace("cone", "parallel")) == ["pixel_size", "first_row", "angles_deg"]
    turn = 'beam = "cone"\nfirst = 0\nstep = 4\nfirst_row = "top"'
    missing = ["pixel_size", "source_to_axis", "source_to_detector"]
    assert missing_keys_of(tiny, CIRCLE.replace('beam = "cone"', turn)) == missing
    assert missing_keys_of(tiny, CIRCLE.replace('beam = "cone"', turn + "\npixel_size = 0.4")) == missing[1:]


def test_a_state_beside_a_circular_reference_is_asked_for_its_angles_alone(tiny):
    circle = 'pixel_size = 0.4\nfirst_row = "top"\nsource_to_axis = 50\nsource_to_detector = 200\nfirst = 0\nstep = 30'
    toml = CIRCLE.replace('beam = "cone"', circle) + '[[states]]\nname = "one"\nradiographs = "one.tif"\n'
    with pytest.raises(InputError, match=r"states.one.geometry: it is missing; give its angles: geometry = \{ angles_"):
        inputs_of(tiny, toml)
