"""Angles of a series of files: constant steps with gaps, numbers in names, tables of names; all in natural order."""

import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.model.finding import Level
from read_experiment_scan import reference_of

TOML = """
[reference]
radiographs = "scan/*.tif"
kind = "line-integrals"
[reference.geometry]
source_to_axis = 60
source_to_detector = 240
pixel_size = 0.4
first_row = "top"
"""
STEP = 4.5


def series(tmp_path, names):
    """One file a name; its pixels are the number of its angle in the list, 0, 1, 2, ..."""
    (tmp_path / "scan").mkdir(exist_ok=True)
    for k, name in enumerate(names):
        if name is not None:
            tifffile.imwrite(tmp_path / "scan" / name, np.full((8, 10), k, np.float32))


def pairs(source):
    """Number of each radiograph, and its angle over the step."""
    numbers = source.radiographs.read()[:, 0, 0]
    assert source.circle is not None
    azimuths = source.geometry.azimuths_deg
    return numbers, azimuths / STEP


def counted(count, gaps=(), first=0, width=1):
    return [None if k in gaps else f"proj_{k + first:0{width}d}.tif" for k in range(count)]


class TestSteps:
    ANGLES = f"first = 0\nstep = {STEP}\n"

    @pytest.mark.parametrize("width", [1, 4])
    @pytest.mark.parametrize("first", [0, 1, 98])
    def test_the_number_of_radiographs_gives_the_count(self, tmp_path, first, width):
        series(tmp_path, counted(24, first=first, width=width))  # proj_2 before proj_10
        numbers, angles = pairs(reference_of(tmp_path, TOML + self.ANGLES))
        np.testing.assert_allclose(numbers, angles, atol=1e-5)
        assert len(numbers) == 24

    @pytest.mark.parametrize("gaps", [(7,), (3, 4, 17)])
    def test_a_gap_is_an_error_that_names_the_files(self, tmp_path, gaps):
        series(tmp_path, counted(24, gaps))
        with pytest.raises(InputError, match=rf"geometry\.step: .*lacks proj_{gaps[0]}\.tif.*set count = 24") as error:
            reference_of(tmp_path, TOML + self.ANGLES)
        assert f"count = {24 - len(gaps)} if not" in str(error.value)

    @pytest.mark.parametrize("gaps", [(7,), (3, 4, 17)])
    def test_with_the_count_the_missing_angles_are_left_out(self, tmp_path, gaps):
        series(tmp_path, counted(24, gaps, first=5))
        source = reference_of(tmp_path, TOML + self.ANGLES + "count = 24\n")
        numbers, angles = pairs(source)
        np.testing.assert_allclose(numbers, angles, atol=1e-5)
        assert any("left out" in f.fact and f.level is Level.NOTE for f in source.findings)
        assert not [f for f in source.findings if f.level is not Level.NOTE]

    def test_with_the_number_of_files_no_angle_was_taken_for_them(self, tmp_path):
        series(tmp_path, counted(24, (7,)))
        source = reference_of(tmp_path, TOML + self.ANGLES + "count = 23\n")
        np.testing.assert_allclose(pairs(source)[1], np.arange(23), atol=1e-5)
        assert any("proj_7.tif" in f.fact for f in source.findings)

    @pytest.mark.parametrize("kept", [(1, 2, 4), (0, 1, 2, 4), (0, 1, 3, 4, 7, 9, 10, 13), (2, 6, 8)])
    def test_few_files_and_many_gaps_are_seen_too(self, tmp_path, kept):
        series(tmp_path, [f"p_{k}.tif" for k in kept])
        with pytest.raises(InputError, match=r"geometry\.step: .*lacks p_\d+\.tif"):
            reference_of(tmp_path, TOML + self.ANGLES)
        least = min(np.diff(kept))
        count = (kept[-1] - kept[0]) // least + 1
        angles = pairs(reference_of(tmp_path, TOML + self.ANGLES + f"count = {count}\n"))[1]
        np.testing.assert_allclose(angles, (np.array(kept) - kept[0]) / least, atol=1e-5)

    @pytest.mark.parametrize("names", [("101550", "101600", "101610"), ("0", "17", "30", "45"), ("100", "200", "300")])
    def test_times_and_places_of_motors_are_no_counters(self, tmp_path, names):
        series(tmp_path, [f"p_{n}.tif" for n in names])
        angles = pairs(reference_of(tmp_path, TOML + self.ANGLES))[1]
        np.testing.assert_allclose(angles, np.arange(len(names)), atol=1e-5)

    def test_another_count_is_an_error(self, tmp_path):
        series(tmp_path, counted(24, (7,)))
        with pytest.raises(InputError, match=r"30 views, but .* holds 23 radiographs"):
            reference_of(tmp_path, TOML + self.ANGLES + "count = 30\n")

    def test_a_state_has_its_own(self, tmp_path):
        series(tmp_path, counted(4))
        assert len(reference_of(tmp_path, TOML + "first = 10\nstep = -90\n").geometry) == 4

    @pytest.mark.parametrize(
        ("keys", "match"),
        [
            ("step = 1\n", "geometry.first: it is missing beside step"),
            ("first = 0\nlast = 9\nstep = 1\n", "geometry.last: it is given beside step"),
            ("first = 0\nstep = 0\n", "geometry.step: it is 0"),
            ("first = 0\n", "last: it is missing beside first; give first, last and count, or first and step"),
            ("angles_deg = [1, 2]\nstep = 1\n", "angles_deg and step are both given"),
        ],
    )
    def test_keys_that_do_not_fit(self, tmp_path, keys, match):
        series(tmp_path, counted(4))
        with pytest.raises(InputError, match=match):
            reference_of(tmp_path, TOML + keys)


class TestNames:
    ANGLES = 'angles_deg = "names"\n'

    @pytest.mark.parametrize(
        "pattern",
        ["scan_{a:.1f}.tif", "scan_{k:03d}_{a:06.2f}.tif", "run2_{k:03d}_angle{a:g}.tif", "{k:02d}_{a:g}deg.tif"],
    )
    def test_angles_beside_counters(self, tmp_path, pattern):
        series(tmp_path, [pattern.format(k=k, a=k * STEP) for k in range(24)])
        source = reference_of(tmp_path, TOML + self.ANGLES)
        numbers, angles = pairs(source)
        np.testing.assert_allclose(numbers, angles, atol=1e-5)
        (note,) = [f for f in source.findings if "in the files' names" in f.fact]
        assert note.level is Level.NOTE
        assert "4.5, 9" in note.fact

    def test_files_are_joined_to_angles_whatever_their_order(self, tmp_path):
        angles = np.random.default_rng(5).permutation(24) * STEP
        series(tmp_path, [f"s_{k:03d}_{a:.1f}.tif" for k, a in enumerate(angles)])
        source = reference_of(tmp_path, TOML + self.ANGLES)
        np.testing.assert_allclose(pairs(source)[1], angles / STEP, atol=1e-5)

    def test_negative_angles(self, tmp_path):
        series(tmp_path, [f"s_{a:+.1f}.tif" for a in (-9.0, -4.5, 0.0, 4.5)])
        angles = reference_of(tmp_path, TOML + self.ANGLES).geometry.azimuths_deg
        np.testing.assert_allclose((angles + 180) % 360 - 180, [-9, -4.5, 0, 4.5], atol=1e-5)

    def test_chosen_whole_degrees(self, tmp_path):
        series(tmp_path, [f"s_{a}.tif" for a in (0, 45, 90, 135)])
        angles = reference_of(tmp_path, TOML + self.ANGLES).geometry.azimuths_deg
        np.testing.assert_allclose(angles, [0, 45, 90, 135], atol=1e-5)

    @pytest.mark.parametrize(
        ("names", "match"),
        [
            ([f"s_{k:03d}.tif" for k in range(12)], "counts the files; give first and step"),
            ([f"s_{k}_{7 * k % 12}.tif" for k in range(12)], r"is the angle is not clear: 0, 0 in s_0_0\.tif"),
            ([f"s_{0.5 * k}.tif" for k in range(12)] + ["preview.tif"], r"preview\.tif of .* named unlike s_#\.tif"),
            (["only.tif", "tilt.tif", "shut.tif"], "named unlike|carry no angle"),
        ],
        ids=["counter", "two", "stranger", "none"],
    )  # fmt: skip
    def test_names_that_do_not_tell(self, tmp_path, names, match):
        series(tmp_path, names)
        with pytest.raises(InputError, match=match) as error:
            reference_of(tmp_path, TOML + self.ANGLES)
        assert "reference.geometry.angles_deg" in str(error.value)

    def test_a_stack_has_no_names(self, tmp_path):
        (tmp_path / "scan").mkdir()
        tifffile.imwrite(tmp_path / "scan" / "a.tif", np.zeros((5, 8, 10), np.float32))
        with pytest.raises(InputError, match='"names" needs one file a radiograph'):
            reference_of(tmp_path, TOML + self.ANGLES)


class TestTableOfNames:
    NAMES = tuple(f"proj_{k}.tif" for k in range(12))
    ANGLES = 'angles_deg = "angles.csv"\n'

    def source(self, tmp_path, lines, names=NAMES):
        series(tmp_path, names)
        (tmp_path / "angles.csv").write_text("\n".join(lines) + "\n")
        return reference_of(tmp_path, TOML + self.ANGLES)

    @pytest.mark.parametrize("order", [slice(None), slice(None, None, -1), slice(1, None, 2)])
    @pytest.mark.parametrize(
        ("line", "header"),
        [
            ("{n},{a}", []), ("{n}\t{a}", ["file\tangle_deg"]), ("{n} {a}", ["# name angle"]),
            ("{a};scan/{n}", ["angle;path"]), ("{k},{n},{a},7.5", ["index,file,theta [deg],exposure"]),
        ],
        ids=["csv", "tabs", "blanks", "semicolons", "more columns"],
    )  # fmt: skip
    def test_angles_go_with_their_files(self, tmp_path, line, header, order):
        lines = [line.format(n=n, a=k * STEP, k=k) for k, n in enumerate(self.NAMES)]
        lines = [*lines[order], *(x for x in lines if x not in lines[order])]
        numbers, angles = pairs(self.source(tmp_path, header + lines))
        np.testing.assert_allclose(numbers, angles, atol=1e-5)

    def test_names_without_suffix_radians_and_decimal_commas(self, tmp_path):
        lines = ["name;theta_rad"]
        lines += [
            f"{n.removesuffix('.tif')};{np.deg2rad(k * STEP):.12f}".replace(".", ",") for k, n in enumerate(self.NAMES)
        ]
        numbers, angles = pairs(self.source(tmp_path, lines))
        np.testing.assert_allclose(numbers, angles, atol=1e-5)

    def test_lines_of_files_that_are_gone_are_left_out(self, tmp_path):
        lines = [f"{n},{k * STEP}" for k, n in enumerate(self.NAMES)]
        numbers, angles = pairs(self.source(tmp_path, lines, counted(12, (3, 4))))
        np.testing.assert_allclose(numbers, angles, atol=1e-5)

    @pytest.mark.parametrize(
        ("lines", "match"),
        [
            ([f"proj_{k}.tif,{k}" for k in range(11)], r"no line names the radiograph proj_11\.tif; it names proj_0"),
            ([f"proj_{min(k, 10)}.tif,{k}" for k in range(12)], r"line 12 names proj_10\.tif a second time"),
            ([f"proj_{k}.tif,{k},{k}" for k in range(12)], "2 columns beside the file names"),
            ([f"proj_{k}.tif,{k if k < 5 else ''}" for k in range(12)], "line"),
            ([f"proj_{k}.tif,{k}" for k in range(11)] + ["proj_11.tif,nan"], "line 12 has the angle 'nan'"),
            (["file,theta furlong"] + [f"proj_{k}.tif,{k}" for k in range(12)], ""),
        ],
    )  # fmt: skip
    def test_bad_tables(self, tmp_path, lines, match):
        if not match:
            assert len(self.source(tmp_path, lines).geometry) == 12
            return
        with pytest.raises(InputError, match=match) as error:
            self.source(tmp_path, lines)
        assert "angles.csv" in str(error.value)
        assert "\n" not in str(error.value)
