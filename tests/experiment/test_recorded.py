"""What NXtomo files record of beam and stage: its effect on line integrals and geometry, and what is refused."""

import h5py
import numpy as np
import pytest

from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_tables import Circular, ReferenceTable, ScanTable
from grainmotion.model.finding import Level
from nxtomo_writer import write_nxtomo

ANGLES = np.arange(0, 360, 30.0)
PANEL = (20, 24)
PIXEL, SOURCE, DETECTOR = 0.4, 50.0, 200.0  # mm; a pixel at the axis is 0.1
POINTS = np.array([[0.3, -0.2, 0.1], [0.0, 0.4, -0.3]])  # in the sample, mm
SHADOW = np.broadcast_to(np.linspace(0, 0.5, PANEL[1]), (len(ANGLES), *PANEL))


def table(**keys):
    sizes = dict(source_to_axis=SOURCE, source_to_detector=DETECTOR) if keys.pop("beam", "cone") == "cone" else {}
    circle = Circular(beam="cone" if sizes else "parallel", pixel_size=PIXEL, first_row="top", **sizes)
    return ReferenceTable(radiographs=["scan.nxs"], geometry=circle, **keys)


def found(tmp_path, records, told=None):
    """The reference scan of an NXtomo file with these records."""
    write_nxtomo(tmp_path / "scan.nxs", SHADOW, ANGLES, records)
    told = told or table()
    return find_scan("reference", told, told, tmp_path)


def pixels(source):
    """Row and column of the points in each view."""
    return source.geometry.project_points(POINTS)


class TestStage:
    """At a stage shift the points appear where points of a shifted sample appear."""

    def moved(self, tmp_path, axis, told=None, unit="mm", scale=1.0):
        ramp = np.linspace(0, 0.5, len(ANGLES))
        name = f"sample/{axis}_translation"
        return ramp, pixels(found(tmp_path, {name: (scale * ramp, unit)}, told)) - pixels(found(tmp_path, {}, told))

    def test_a_sample_that_rises_moves_to_the_top_of_the_image(self, tmp_path):
        ramp, change = self.moved(tmp_path, "z", table(beam="parallel"))
        np.testing.assert_allclose(change[..., 0], np.tile(-ramp[:, None] / PIXEL, 2), atol=1e-9)  # row 0 is the top
        np.testing.assert_allclose(change[..., 1], 0, atol=1e-9)

    def test_a_sample_that_moves_along_x_moves_to_higher_columns_in_every_view(self, tmp_path):
        ramp, change = self.moved(tmp_path, "x", table(beam="parallel"))
        np.testing.assert_allclose(change[..., 1], np.tile(ramp[:, None] / PIXEL, 2), atol=1e-9)
        np.testing.assert_allclose(change[..., 0], 0, atol=1e-9)

    def test_a_sample_that_moves_along_the_beam_is_magnified_less(self, tmp_path):
        ramp, change = self.moved(tmp_path, "y")
        still = pixels(found(tmp_path, {})) - (np.array(PANEL) - 1) / 2
        shrinking = (still * change).sum(axis=(1, 2)) / (still**2).sum(axis=(1, 2))
        np.testing.assert_allclose(shrinking, -ramp / SOURCE, rtol=0.05, atol=1e-9)
        assert np.abs(self.moved(tmp_path, "y", table(beam="parallel"))[1]).max() < 1e-9

    @pytest.mark.parametrize("axis", ["x", "y", "z"])
    def test_it_equals_a_sample_that_moved(self, tmp_path, axis):
        ramp = np.linspace(0, 0.5, len(ANGLES))
        source = found(tmp_path, {f"sample/{axis}_translation": (ramp, "mm")})
        still = found(tmp_path, {}).geometry
        for k, angle in enumerate(np.deg2rad(ANGLES)):
            turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
            moved = POINTS + turn @ (ramp[k] * np.eye(3)["xyz".index(axis)])
            np.testing.assert_allclose(pixels(source)[k], still.project_points(moved)[k], atol=1e-9)

    @pytest.mark.parametrize(("unit", "scale"), [("m", 1e-3), ("um", 1e3), ("mm", 1.0)])
    def test_units(self, tmp_path, unit, scale):
        expected = self.moved(tmp_path, "z")[1]
        np.testing.assert_allclose(self.moved(tmp_path, "z", unit=unit, scale=scale)[1], expected, atol=1e-9)

    def test_directions_can_be_told(self, tmp_path):
        up = self.moved(tmp_path, "y", table(motors=("-x", "z", "y")))[1]
        np.testing.assert_allclose(up, self.moved(tmp_path, "z")[1], atol=1e-9)

    def test_a_finding_tells_what_was_used(self, tmp_path):
        (note,) = found(tmp_path, {"sample/z_translation": (np.linspace(3, 3.5, len(ANGLES)), "mm")}).findings
        assert (note.level, note.check) == (Level.NOTE, "motors")
        assert "z 0 to 0.5 mm" in note.evidence

    def test_chosen_views_keep_their_places(self, tmp_path):
        ramp = {"sample/z_translation": (np.linspace(0, 0.5, len(ANGLES)), "mm")}
        every, some = found(tmp_path, ramp), found(tmp_path, ramp, table(views="1::3"))
        np.testing.assert_array_equal(some.geometry.vectors, every.geometry.vectors[1::3])

    @pytest.mark.parametrize("values", [np.full(len(ANGLES), 7.3), 7.3, 7.3 + 1e-4 * np.sin(ANGLES)])
    def test_a_stage_at_rest_changes_nothing(self, tmp_path, values):
        source = found(tmp_path, {"sample/z_translation": (values, "mm"), "sample/x_translation": (values, "mm")})
        np.testing.assert_array_equal(source.geometry.vectors, found(tmp_path, {}).geometry.vectors)
        assert source.findings == ()

    def test_it_can_be_turned_off(self, tmp_path):
        ramp = {"sample/z_translation": (np.linspace(0, 0.5, len(ANGLES)), "mm")}
        source = found(tmp_path, ramp, table(motors=False))
        np.testing.assert_array_equal(source.geometry.vectors, found(tmp_path, {}).geometry.vectors)

    @pytest.mark.parametrize(
        ("values", "unit", "word"),
        [
            (np.linspace(0, 0.5, 5), "mm", "5 numbers"),
            (np.where(ANGLES > 100, np.nan, 0.1), "mm", "no number"),
            (np.linspace(0, 0.5, len(ANGLES)), "deg", "no length"),
            (np.linspace(0, 0.5, len(ANGLES)), "m", "nothing would be in view"),
        ],
    )
    def test_what_cannot_be_is_named_and_not_used(self, tmp_path, values, unit, word):
        source = found(tmp_path, {"sample/x_translation": (values, unit)})
        np.testing.assert_array_equal(source.geometry.vectors, found(tmp_path, {}).geometry.vectors)
        (warning,) = source.findings
        assert warning.level is Level.WARNING
        assert word in warning.fact

    def test_without_a_unit_it_is_taken_as_mm_and_named(self, tmp_path):
        source = found(tmp_path, {"sample/z_translation": (np.linspace(0, 0.5, len(ANGLES)), "")})
        assert [f.level for f in source.findings] == [Level.WARNING, Level.NOTE]
        assert "mm" in source.findings[0].fact


class TestStateAtAnotherPlace:
    """Places of a state count from the first projection of the reference, so that a moved stage is no motion."""

    def state(self, tmp_path, reference, state):
        told = table()
        write_nxtomo(tmp_path / "scan.nxs", SHADOW, ANGLES, reference)
        write_nxtomo(tmp_path / "state.nxs", SHADOW[:4], ANGLES[:4], state)
        return find_scan("states.one", ScanTable(radiographs=["state.nxs"]), told, tmp_path)

    def test_the_difference_counts(self, tmp_path):
        at = {"sample/z_translation": (np.linspace(12.0, 12.5, len(ANGLES)), "mm")}
        moved = self.state(tmp_path, at, {"sample/z_translation": (12.3, "mm")})
        still = self.state(tmp_path, at, {"sample/z_translation": (12.0, "mm")})
        shift = moved.geometry.vectors[:, :3] - still.geometry.vectors[:, :3]
        np.testing.assert_allclose(shift, np.tile([0, 0, -0.3], (4, 1)), atol=1e-9)

    def test_a_reference_without_motors_gives_no_zero(self, tmp_path):
        alone = self.state(tmp_path, {}, {"sample/z_translation": (12.3, "mm")})
        np.testing.assert_array_equal(alone.geometry.vectors, self.state(tmp_path, {}, {}).geometry.vectors)


class TestMonitor:
    BEAM = 1 + 0.2 * np.sin(np.arange(len(ANGLES)))

    def read(self, tmp_path, monitor):
        """Line integrals of a scan whose beam varies, with this monitor instead of the true one; and findings."""
        write_nxtomo(tmp_path / "scan.nxs", SHADOW, ANGLES, {"control/data": (self.BEAM, "")})
        with h5py.File(tmp_path / "scan.nxs", "a") as file:
            true = file["entry0000/control/data"][()]
            del file["entry0000/control/data"]
            file["entry0000/control/data"] = monitor(true)
        source = find_scan("reference", table(), table(), tmp_path)
        return source.read()[0].line_integrals, source

    @pytest.mark.parametrize("unit", [1.0, 2e-7])
    def test_counts_are_divided_by_it(self, tmp_path, unit):
        images, source = self.read(tmp_path, lambda true: unit * true)
        np.testing.assert_allclose(images, SHADOW[:, ::-1], atol=1e-3)
        assert [(f.level, f.check) for f in source.findings] == [(Level.NOTE, "monitor")]

    def test_chosen_views_keep_their_monitor(self, tmp_path):
        images, source = self.read(tmp_path, lambda true: true)
        np.testing.assert_array_equal(source.select(np.array([5, 2])).read()[0].line_integrals, images[[5, 2]])

    @pytest.mark.parametrize(
        "monitor",
        [np.zeros_like, lambda true: np.where(true > 1, np.nan, true), lambda true: true[:4], lambda true: -true,
         lambda true: 1 + np.arange(len(true)) ** 3],
        ids=["zeros", "NaN", "length", "negative", "counter"],
    )  # fmt: skip
    def test_nonsense_is_named_and_not_used(self, tmp_path, monitor):
        images, source = self.read(tmp_path, monitor)
        expected = SHADOW[:, ::-1] - np.log(self.BEAM / self.BEAM.mean())[:, None, None]
        np.testing.assert_allclose(images, expected, atol=1e-3)
        (warning,) = source.findings
        assert (warning.level, warning.check) == (Level.WARNING, "monitor")

    def test_a_constant_one_changes_nothing(self, tmp_path):
        _, source = self.read(tmp_path, np.ones_like)
        assert source.monitor is None
        assert source.findings == ()


class TestSizes:
    @pytest.mark.parametrize(("size", "unit"), [(0.4, "mm"), (4e-4, "m"), (4e-4, ""), (100, "um"), (0.4, "")])
    def test_the_told_pixel_or_that_at_the_sample_agree(self, tmp_path, size, unit):
        assert found(tmp_path, {"instrument/detector/x_pixel_size": (size, unit)}).findings == ()

    @pytest.mark.parametrize(("size", "unit"), [(0.2, "mm"), (0.41, "mm"), (0.4, "um")])
    def test_a_contradiction_is_named(self, tmp_path, size, unit):
        (warning,) = found(tmp_path, {"instrument/detector/x_pixel_size": (size, unit)}).findings
        assert (warning.level, warning.check) == (Level.WARNING, "sizes")
        assert "pixel_size" in warning.fact

    def test_distances(self, tmp_path):
        assert found(tmp_path, {"instrument/detector/distance": (0.15, "m")}).findings == ()
        (warning,) = found(tmp_path, {"instrument/detector/distance": (0.12, "m")}).findings
        assert "120" in warning.evidence or "0.12" in warning.evidence
