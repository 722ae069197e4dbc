"""What a folder holds, and the experiment file that is drafted from it."""

from pathlib import Path

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.first_draft import draft_experiment
from grainmotion.experiment.folder_contents import folder_contents
from grainmotion.experiment.found_scans import found_scans
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.geometry_csv import write_geometry
from grainmotion.io.tiff import write_tiff
from grainmotion.model.geometry import Geometry
from nxtomo_writer import write_nxtomo

PANEL = (6, 8)
CIRCLE = dict(source_to_axis=50.0, source_to_detector=200.0)


def images(folder, count, name="proj_{:04d}.tif", value=100):
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(count):
        write_tiff(folder / name.format(k), np.full(PANEL, value + k, np.uint16))


@pytest.fixture
def laboratory(tmp_path):
    """A scan with its open beam beside it, two states in folders of their own, and a log of the press."""
    images(tmp_path / "initial", 40)
    images(tmp_path / "initial", 3, "flat_{:03d}.tif", 900)
    images(tmp_path / "initial", 2, "dark_{:03d}.tif", 1)
    for name in ("load 10", "load 2"):
        images(tmp_path / name, 4, "im{}.tif")
    (tmp_path / "load 2" / "angles.txt").write_text("0\n45\n90\n135\n")
    (tmp_path / "load 10" / "force.txt").write_text("1.5\n2.5\n3.5\n4.5\n")
    write_geometry(tmp_path / "initial" / "views.csv", Geometry.cone(np.arange(40) * 9.0, PANEL, 0.4, **CIRCLE))
    return tmp_path


class TestContents:
    def test_images_are_told_apart_by_their_names(self, laboratory):
        sets = {s.spec: (s.shape, s.role) for s in folder_contents(laboratory).images}
        assert sets == {
            "initial/dark_*.tif": ((2, *PANEL), "darks"),
            "initial/flat_*.tif": ((3, *PANEL), "flats"),
            "initial/proj_*.tif": ((40, *PANEL), "radiographs"),
            "load 2/*.tif": ((4, *PANEL), "radiographs"),
            "load 10/*.tif": ((4, *PANEL), "radiographs"),
        }

    def test_states_come_in_the_order_of_their_numbers(self, laboratory):
        specs = [s.spec for s in folder_contents(laboratory).images]
        assert specs.index("load 2/*.tif") < specs.index("load 10/*.tif")

    @pytest.mark.parametrize("name", ["reference", "coffee-office", "darkroom", "flatten", "offsetting"])
    def test_a_word_within_another_is_no_role(self, tmp_path, name):
        images(tmp_path / name, 12)
        assert folder_contents(tmp_path).images[0].role == "radiographs"

    def test_results_and_hidden_folders_are_left_out(self, laboratory):
        images(laboratory / "results", 3)
        (laboratory / "results" / "stages.json").write_text("{}")
        images(laboratory / ".cache", 3)
        (laboratory / "inspection.png").write_bytes(b"drawn by an earlier inspection")
        contents = folder_contents(laboratory)
        assert len(contents.images) == 5
        assert contents.results == ("results",)

    def test_a_scanners_file_owns_its_images(self, tmp_path):
        write_nxtomo(tmp_path / "scan.nxs", np.zeros((4, *PANEL)), np.arange(4.0))
        (tmp_path / "other.h5").write_bytes(b"no HDF5 at all")
        contents = folder_contents(tmp_path)
        assert [name for name, _ in contents.scans] == ["scan.nxs"]
        assert contents.images == ()

    def test_damaged_images_are_told(self, tmp_path):
        (tmp_path / "a.tif").write_bytes(b"II*\0 broken")
        (only,) = folder_contents(tmp_path).images
        assert only.problem
        assert "a.tif" in only.sentence


class TestDraft:
    def test_the_largest_scan_is_the_reference_and_the_others_are_states(self, laboratory):
        draft = draft_experiment(folder_contents(laboratory))
        assert 'radiographs = "initial/proj_*.tif"' in draft.text
        assert 'flats = "initial/flat_*.tif"' in draft.text
        assert 'geometry = "initial/views.csv"' in draft.text
        assert 'geometry = { angles_deg = "load 2/angles.txt" }' in draft.text
        assert draft.text.index('name = "load 2"') < draft.text.index('name = "load 10"')

    def test_a_log_of_forces_is_no_file_of_angles(self, laboratory):
        draft = draft_experiment(folder_contents(laboratory))
        assert "force.txt" not in draft.text
        assert draft.todo == ("state 'load 10': the angles of its 4 radiographs",)

    def test_a_complete_draft_is_a_valid_experiment(self, laboratory):
        views = Geometry.cone([0, 45, 90, 135], PANEL, 0.4, **CIRCLE)
        for name in ("load 2", "load 10"):
            write_geometry(laboratory / name / "geometry.csv", views)
        draft = draft_experiment(folder_contents(laboratory))
        assert draft.todo == ()
        path = laboratory / "experiment.toml"
        path.write_text(draft.text)
        inputs = find_inputs(read_experiment(path))
        assert [scan.key for scan in inputs.states] == ["states.load 2", "states.load 10"]
        np.testing.assert_allclose(inputs.states[0].geometry.vectors, views.vectors)

    def test_without_tables_the_circle_is_to_be_filled_in(self, tmp_path):
        images(tmp_path, 20, "scan{:03d}.tif")
        draft = draft_experiment(folder_contents(tmp_path))
        assert "[reference.geometry]" in draft.todo[0]
        assert "[[states]]" in draft.todo[1]
        for key in ("source_to_axis", "pixel_size", "first_row", "angles_deg"):
            assert f"# {key} = " in draft.text
        assert "pixel_size, first_row and angles" in draft.todo[0]
        assert "# angles_deg = { first = 0, last = 342, count = 20 }  # TODO" in draft.text

    def test_angles_in_a_folder_above_the_images_are_those_of_the_scan_with_as_many(self, tmp_path):
        images(tmp_path / "full", 20)
        images(tmp_path / "load", 3)
        for name, count in (("angles.csv", 20), ("angles of loads.txt", 3), ("force.txt", 20)):
            (tmp_path / name).write_text("\n".join(map(str, range(0, 18 * count, 18))))
        draft = draft_experiment(folder_contents(tmp_path))
        assert '\nangles_deg = "angles.csv"\n' in draft.text
        assert 'geometry = { angles_deg = "angles of loads.txt" }' in draft.text
        assert draft.todo == ("[reference.geometry]: distances, pixel_size and first_row, in the lines with TODO",)

    def test_angles_in_the_names_of_a_state_are_proposed(self, tmp_path):
        images(tmp_path / "full", 12)
        images(tmp_path / "a", 3)
        for angle in (0, 45, 90):
            images(tmp_path / "b", 1, f"p_{angle:03d}.5deg.tif")
            images(tmp_path / "c", 1, f"p_{angle:03d}.5.tif")
        lines = draft_experiment(folder_contents(tmp_path)).text.splitlines()
        assert (
            '# geometry = { angles_deg = "names" }  # TODO: if 0.5, 45.5, 90.5 in the files\' names are the angles'
            in lines
        )
        assert 'geometry = { angles_deg = "names" }    # 0.5, 45.5, 90.5' in lines  # a word says what they are
        assert "# geometry = { angles_deg = [ ] }  # TODO: the angle of each of the 3" in lines

    def test_scans_of_one_name_get_names_of_their_own(self, tmp_path):
        images(tmp_path / "a", 20)
        for name in ("b/scan", "c/scan"):
            images(tmp_path / name, 3)
        lines = draft_experiment(folder_contents(tmp_path)).text.splitlines()
        names = [line for line in lines if line.startswith("name = ")]
        assert len(set(names)) == 2

    def test_a_later_full_scan_is_pointed_out(self, tmp_path):
        images(tmp_path / "one", 20)
        images(tmp_path / "two", 19)
        assert 'views = "' in draft_experiment(folder_contents(tmp_path)).text

    def test_few_radiographs_are_no_reference(self, tmp_path):
        images(tmp_path, 4)
        with pytest.raises(InputError, match="none is a full scan"):
            draft_experiment(folder_contents(tmp_path))

    def test_an_empty_folder_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="no radiographs"):
            draft_experiment(folder_contents(tmp_path))


def test_a_file_that_another_one_includes_is_no_scan_of_its_own(tmp_path, monkeypatch):
    images(tmp_path / "Proj", 1)
    (tmp_path / "unireconstruction.xml").write_text(
        '<unireconstruction><conebeam><profile images="1"/>'
        '<acquisitioninfo><geometry sod="60" sdd="240"/></acquisitioninfo></conebeam></unireconstruction>'
    )
    numbers = [60, 0, 0, -180, 0, 0, -180, 0.6, 0, -180, 0, 0.8]
    (tmp_path / "geom.csv").write_text("a;\nb;\n" + ";".join(["proj_0000.tif", *map(str, numbers)]))
    monkeypatch.chdir(tmp_path)
    contents = folder_contents(Path())
    assert [name for name, _ in contents.scans] == ["unireconstruction.xml"]
    assert (contents.images, contents.tables, contents.problems) == ((), (), ())


NIKON = "[XTekCT]\nName={}\nSrcToObject=50\nSrcToDetector=200\nDetectorPixelSizeX=0.4\nProjections={}\n" \
        "AngularStep=9\nWhiteLevel=900\nObjectOffsetX={}\n"  # fmt: skip


class TestScansOfOneScanner:
    """Folders in disorder: two files of one scan, images moved away, previews, vectors of views."""

    def test_a_second_file_of_the_same_radiographs_is_no_state(self, tmp_path):
        images(tmp_path, 40, "a_{:04d}.tif")
        (tmp_path / "a.xtekct").write_text(NIKON.format("a", 39, 0))
        (tmp_path / "a recon.xtekct").write_text(NIKON.format("a", 39, 0.2))
        contents = folder_contents(tmp_path)
        assert len(contents.scans) == 1
        assert any("it describes the same radiographs as" in problem for problem in contents.problems)

    def test_images_that_were_moved_away_keep_their_scanners_file(self, tmp_path):
        images(tmp_path / "images", 40, "a_{:04d}.tif")
        (tmp_path / "a.xtekct").write_text(NIKON.format("a", 40, 0))
        images(tmp_path / "step", 4, "r_{:03d}deg.tif")
        draft = draft_experiment(folder_contents(tmp_path))
        assert draft.todo == ()
        (tmp_path / "experiment.toml").write_text(draft.text)
        inputs = find_inputs(read_experiment(tmp_path / "experiment.toml"))
        assert len(inputs.reference.geometry) == 40
        assert inputs.reference.white_level == 900
        assert len(inputs.states[0].geometry) == 4

    def test_a_single_image_beside_radiographs_is_no_state(self, tmp_path):
        images(tmp_path, 41, "a_{:04d}.tif")
        (tmp_path / "a.xtekct").write_text(NIKON.format("a", 40, 0))
        images(tmp_path, 1, "preview.tif")
        assert [scan.spec for scan in found_scans(folder_contents(tmp_path))] == ["a.xtekct"]

    @pytest.mark.parametrize("suffix", [".npy", ".geom"])
    def test_vectors_of_views_are_no_images(self, tmp_path, suffix):
        images(tmp_path / "scan", 40)
        views = Geometry.cone(np.arange(40) * 9.0, PANEL, 0.4, **CIRCLE).vectors
        np.save(tmp_path / "scan/views.npy", views) if suffix == ".npy" else np.savetxt(
            tmp_path / "scan/views.geom", views
        )
        contents = folder_contents(tmp_path)
        assert contents.tables == (f"scan/views{suffix}",)
        assert len(contents.images) == 1
        assert f'geometry = "scan/views{suffix}"' in draft_experiment(contents).text


class TestTheScannersFileIsNotNamed:
    """Users name the folder or the images; the error names the file that tells the geometry."""

    @pytest.mark.parametrize("name", ["scan", "scan/*.tif"])
    @pytest.mark.parametrize("states", ["", '[[states]]\nname = "a"\nradiographs = "b/*.tif"\ngeometry = {step = 9}\n'])
    def test_the_scanners_file_beside_images_is_proposed(self, tmp_path, name, states):
        images(tmp_path / "scan", 40, "a_{:04d}.tif")
        (tmp_path / "scan/a.xtekct").write_text(NIKON.format("a", 40, 0))
        path = tmp_path / "experiment.toml"
        path.write_text(f'[reference]\nradiographs = "{name}"\n{states}')
        with pytest.raises(InputError, match=r'name the scanner.s file.*radiographs = "scan/a\.xtekct"'):
            find_inputs(read_experiment(path))

    @pytest.mark.parametrize(
        ("name", "match"),
        [
            ('"scan\\beads.xtekct"', "holds a control character.*write / instead of"),
            ("'scan\\beads.xtekct'", "no such file; write / instead of"),
        ],
    )
    def test_paths_of_windows(self, tmp_path, name, match):
        path = tmp_path / "experiment.toml"
        path.write_text(f"[reference]\nradiographs = {name}\n")
        with pytest.raises(InputError, match=match) as caught:
            find_inputs(read_experiment(path))
        assert "\b" not in str(caught.value)
