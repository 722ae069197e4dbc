"""ASTRA's vectors, as .npy and as text: the images of the laboratory scanner are reproduced."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from lab_scanner import Lab
from read_experiment_scan import misfit, reference_of

STAGE = np.array([0.0, 35.0, 140.0, 250.0])
SHIFTS = np.array([[0.0, 0.0], [0.5, -0.3], [-0.4, 0.2], [0.1, 0.6]])  # of the panel in each view: right, up, mm
SAME, WRONG = 1e-6, 0.05
TOML = '[reference]\nradiographs = "images.npy"\nkind = "line-integrals"\n[reference.geometry]\n'


def labs(parallel=False):
    return [Lab(panel_shift=(a, b), parallel=parallel, pixel=0.15 if parallel else 0.4) for a, b in SHIFTS]


def vectors(parallel=False):
    """The views of ASTRA's ``cone_vec``, by its definition: the object is at rest, the scanner turns clockwise."""
    rows = []
    for lab, angle, (right, up) in zip(labs(parallel), np.deg2rad(STAGE), SHIFTS, strict=True):
        turn = np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        source = [0, 1, 0] if parallel else [0, -lab.source_to_axis, 0]
        panel = [right, lab.source_to_panel - lab.source_to_axis, up]
        rows.append([*turn @ source, *turn @ panel, *turn @ [lab.pixel, 0, 0], 0, 0, -lab.pixel])
    return np.array(rows)


def source_of(tmp_path, array, name="views.npy", extra="", parallel=False):
    images = [lab.image(a) for lab, a in zip(labs(parallel), STAGE, strict=True)]
    np.save(tmp_path / "images.npy", np.stack(images))
    if name.endswith(".npy"):
        np.save(tmp_path / name, array)
    else:
        np.savetxt(tmp_path / name, array)
    return reference_of(tmp_path, f'{TOML}file = "{name}"\n{extra}')


@pytest.mark.parametrize("name", ["views.npy", "scan_geom_corrected.geom"])
def test_cone_beam_with_shifts_of_each_view(tmp_path, name):
    assert misfit(source_of(tmp_path, vectors(), name)) < SAME


@pytest.mark.parametrize("name", ["views.npy", "views.geom"])
def test_parallel_beam(tmp_path, name):
    source = source_of(tmp_path, vectors(True), name, 'beam = "parallel"\n', parallel=True)
    assert source.geometry.beam == "parallel"
    assert misfit(source) < SAME


def test_lengths_in_voxels_are_scaled_by_the_pixel(tmp_path):
    assert misfit(source_of(tmp_path, vectors() / 0.1, extra="pixel_size = 0.4\n")) < SAME
    turned = vectors(True)
    turned[:, 3:] /= 0.15
    assert misfit(source_of(tmp_path, turned, extra='pixel_size = 0.15\nbeam = "parallel"\n', parallel=True)) < SAME


@pytest.mark.parametrize("columns", [slice(0, 6), slice(6, 9), slice(9, 12)])
def test_every_wrong_sign_is_seen(tmp_path, columns):
    wrong = vectors()
    wrong[:, columns] *= -1
    assert misfit(source_of(tmp_path, wrong)) > WRONG


@pytest.mark.parametrize(
    ("array", "extra", "match"),
    [
        (np.ones((4, 6)), "", "6 columns are of a geometry in a plane"),
        (np.ones(12), "", r"an array \(12,\) is no list"),
        (np.full((4, 12), np.nan), "", r"row 1 \(view 0\) holds NaN"),
        (np.array(["a"]), "", "no array of numbers"),
        (vectors()[:3], "", "3 views, but images.npy .* holds 4 radiographs"),
        (vectors() * np.repeat([-1, 1], [3, 9]), "", "not between source and panel; check the signs of sx"),
        (vectors(), 'first_row = "top"\n', "first_row: it has no effect beside views.npy"),
        (vectors(), "detector_offset = [1, 0]\n", "detector_offset: it has no effect"),
        (vectors(), 'beam = "parallel"\n', 'as of a cone beam; set beam = "cone"'),
        (vectors(True), "", 'of length 1, as of a parallel beam; set beam = "parallel"'),
        (np.zeros((4, 12)), "", "views.npy"),
        (np.zeros((0, 12)), "", r"views\.npy"),
    ],
)  # fmt: skip
def test_bad_arrays(tmp_path, array, extra, match):
    with pytest.raises(InputError, match=match) as error:
        source_of(tmp_path, array, extra=extra)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("; CrystFEL geometry\nphoton_energy = 9000\n", "line 1 is '; CrystFEL geometry'"),
        ("1 2 3\n1 2\n", "line 2 has 2 numbers"),
        ("", r"no list of views|empty"),
        ("# only a comment\n", "no list of views"),
    ],
)
def test_foreign_text(tmp_path, text, match):
    source_of(tmp_path, vectors(), "views.geom")
    (tmp_path / "views.geom").write_text(text)
    with pytest.raises(InputError, match=match):
        reference_of(tmp_path, f'{TOML}file = "views.geom"\n')


def test_truncated_array(tmp_path):
    source_of(tmp_path, vectors())
    (tmp_path / "views.npy").write_bytes((tmp_path / "views.npy").read_bytes()[:150])
    with pytest.raises(InputError, match=r"views\.npy: truncated or damaged"):
        reference_of(tmp_path, f'{TOML}file = "views.npy"\n')
