"""Exchange of motions with spam: what is in the file, and what is read from it; `test_spam_programs.py` runs spam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from converged_motions import converged
from grainmotion.errors import InputError
from grainmotion.io.spam import read_ddic_tsv, write_ddic_tsv
from grainmotion.io.spam_table import ADDED_COLUMNS, DDIC_COLUMNS, GRADIENT
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume
from grainmotion.rotations import apply_motion, rotation_matrix

GRID = Volume.zeros((48, 52, 56), 0.05, (0.3, -0.2, 1.0))


@pytest.fixture
def motions() -> Motions:
    """Labels 2, 3 and 6, with large rotations."""
    random = np.random.default_rng(4)
    centers = GRID.origin + random.uniform(10, 40, (3, 3)) * GRID.voxel_size
    return converged([2, 3, 6], centers, random.normal(size=(3, 3)) * 0.2, random.normal(size=(3, 3)) * 60)


class TestRoundTrip:
    def test_all_stored_values_are_read_back(self, tmp_path, motions):
        write_ddic_tsv(tmp_path / "a-ddic.tsv", motions, GRID)
        back = read_ddic_tsv(tmp_path / "a-ddic.tsv", GRID)
        np.testing.assert_array_equal(back.labels, motions.labels)
        np.testing.assert_array_equal(back.statuses, motions.statuses)
        np.testing.assert_array_equal(back.iterations, motions.iterations)
        np.testing.assert_allclose(back.residuals, motions.residuals, atol=1e-7)
        np.testing.assert_allclose(back.centers, motions.centers, atol=1e-8)
        np.testing.assert_allclose(back.translations, motions.translations, atol=1e-8)
        np.testing.assert_allclose(back.matrices, motions.matrices, atol=2e-7)

    def test_unknown_motions_become_not_fitted(self, tmp_path, motions):
        unknown = np.where(np.arange(3)[:, None] == 1, np.nan, motions.translations)
        statuses = np.array(["converged", "left-field", "not-converged"], dtype="<U20")
        write_ddic_tsv(tmp_path / "a.tsv", replace(motions, translations=unknown, statuses=statuses), GRID)
        back = read_ddic_tsv(tmp_path / "a.tsv", GRID)
        assert list(back.statuses) == ["converged", "not-fitted", "not-fitted"]
        assert np.isnan(back.translations[1:]).all()
        assert np.isnan(back.rotations[1:]).all()
        assert back.reasons[0] == ""
        assert back.reasons[1] == "spam returned status -7: is missing, or had no start"
        assert back.reasons[2] == "spam returned status -1: diverged"

    def test_columns_are_found_by_name(self, tmp_path, motions):
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        table = pd.read_csv(tmp_path / "a.tsv", sep="\t")
        table.insert(0, "note", "x")
        mixed = list(np.random.default_rng(1).permutation(table.columns))
        table[mixed].to_csv(tmp_path / "b.tsv", sep="\t", index=False, na_rep="nan")
        ours, other = (read_ddic_tsv(tmp_path / name, GRID) for name in ("a.tsv", "b.tsv"))
        for name in ("labels", "centers", "translations", "rotations", "statuses", "iterations"):
            np.testing.assert_array_equal(getattr(other, name), getattr(ours, name))

    def test_no_grains(self, tmp_path):
        write_ddic_tsv(tmp_path / "a.tsv", Motions.identity(np.zeros(0, int), np.zeros((0, 3))), GRID)
        assert len(read_ddic_tsv(tmp_path / "a.tsv", GRID)) == 0


class TestFormat:
    def test_rows_by_label_in_voxels_and_zyx_order(self, tmp_path):
        """A grain at voxel (z, y, x) = (10, 20, 30) that moves by 1, 2 and 3 voxels along z, y and x."""
        h = GRID.voxel_size
        center = GRID.origin + h * np.array([[30.0, 20.0, 10.0]])
        one = converged([2], center, h * np.array([[3.0, 2.0, 1.0]]), np.array([[0.0, 0.0, 90.0]]))
        write_ddic_tsv(tmp_path / "a.tsv", one, GRID)
        lines = (tmp_path / "a.tsv").read_text().splitlines()
        assert tuple(lines[0].split("\t")) == DDIC_COLUMNS + ADDED_COLUMNS
        assert lines[0].startswith(
            "Label\tZpos\tYpos\tXpos\tZdisp\tYdisp\tXdisp\tFzz\tFzy\tFzx\tFyz\tFyy\tFyx\tFxz\tFxy\tFxx\t"
            "PSCC\terror\titerations\treturnStatus\tdeltaPhiNorm\tLabelDilate\tpixelSearchCC\t"
        )
        assert all(
            word == "nan" or len(word.partition(".")[2]) == 7 for word in lines[3].split("\t")
        )  # %.7f, integers too
        rows = [dict(zip(DDIC_COLUMNS, map(float, line.split("\t")))) for line in lines[1:]]
        background = {"Zpos": 0, "Ypos": 0, "Xpos": 0, "Zdisp": 0, "Ydisp": 0, "Xdisp": 0, "returnStatus": 0}
        assert {key: rows[0][key] for key in background} == background
        assert [rows[0][c] for c in GRADIENT] == list(np.eye(3).ravel())
        assert [rows[1][c] for c in GRADIENT] == list(np.eye(3).ravel())
        assert [row["Label"] for row in rows] == [0, 1, 2]
        assert np.isnan(rows[1]["Zpos"])
        assert rows[1]["returnStatus"] < 0
        expected = {"Zpos": 10, "Ypos": 20, "Xpos": 30, "Zdisp": 1, "Ydisp": 2, "Xdisp": 3, "returnStatus": 2}
        assert {key: rows[2][key] for key in expected} == pytest.approx(expected)
        # A rotation by 90° about z takes x to y: F_yx = 1.
        assert rows[2]["Fyx"] == pytest.approx(1)
        assert rows[2]["Fxy"] == pytest.approx(-1)
        assert rows[2]["Fzz"] == pytest.approx(1)

    def test_motions_are_converted_to_the_centres_of_the_labels(self, tmp_path, motions):
        labels = np.zeros(GRID.shape, np.int32)
        for label, z in zip((2, 3, 6), (5, 20, 35)):
            labels[z : z + 6, 10:15, 20:24] = label
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, labels)
        back = read_ddic_tsv(tmp_path / "a.tsv", GRID)
        expected = GRID.origin + GRID.voxel_size * np.array([[21.5, 12.0, z + 2.5] for z in (5, 20, 35)])
        np.testing.assert_allclose(back.centers, expected, atol=1e-8)
        points = np.random.default_rng(0).normal(size=(3, 3))
        np.testing.assert_allclose(
            apply_motion(back.matrices, back.translations, back.centers, points),
            apply_motion(motions.matrices, motions.translations, motions.centers, points),
            atol=1e-6,
        )

    def test_rotation_of_a_deformation_gradient_with_strain(self, tmp_path, motions):
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        lines = [line.split("\t") for line in (tmp_path / "a.tsv").read_text().splitlines()]
        stretch = np.diag([1.1, 0.95, 1.02])
        first = DDIC_COLUMNS.index("Fzz")
        for line in lines[1:]:
            gradient = np.array(line[first : first + 9], dtype=float).reshape(3, 3) @ stretch
            line[first : first + 9] = [repr(float(x)) for x in gradient.ravel()]
        (tmp_path / "b.tsv").write_text("\n".join("\t".join(line) for line in lines))
        np.testing.assert_allclose(read_ddic_tsv(tmp_path / "b.tsv", GRID).matrices, motions.matrices, atol=2e-7)


class TestBadInput:
    def test_missing_file_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="no such file"):
            read_ddic_tsv(tmp_path / "none.tsv", GRID)

    @pytest.mark.parametrize(
        ("text", "fact"),
        [
            ("Label\tZpos\n1\t2\n", "columns .* are missing"),
            ("NodeNumber\tZpos\n1\t2\n", "NodeNumber"),
            ("\t".join((*DDIC_COLUMNS, "note")) + "\n" + "\t".join(["1"] * 22 + ["x"]) + "\n", None),
            ("\t".join(DDIC_COLUMNS) + "\n" + "\t".join(["1.5"] + ["1"] * 21) + "\n", "Label is 1.5 in row 1"),
            ("\t".join(DDIC_COLUMNS) + "\n" + "\t".join(["-1"] + ["1"] * 21) + "\n", "Label is -1 in row 1"),
            ("\t".join(DDIC_COLUMNS) + "\n" + "\t".join(["1"] * 12) + "\n", "row 1 has no returnStatus: .*truncated"),
            (
                "\t".join(DDIC_COLUMNS) + "\n" + "\t".join(["1", "two"] + ["1"] * 20) + "\n",
                "Zpos is 'two' in row 1",
            ),
            ("\t".join(DDIC_COLUMNS) + "\n" + 2 * ("\t".join(["1"] * 22) + "\n"), "given twice"),
            ("\x00\x01", r"first line begins with .*lacks the columns|no table"),
        ],
    )
    def test_other_tables_are_refused(self, tmp_path, text, fact):
        (tmp_path / "bad.tsv").write_text(text)
        if fact is None:  # a column that is not used may hold anything
            assert len(read_ddic_tsv(tmp_path / "bad.tsv", GRID)) == 1
            return
        with pytest.raises(InputError, match=fact) as error:
            read_ddic_tsv(tmp_path / "bad.tsv", GRID)
        assert "bad.tsv" in str(error.value)

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            (lambda t: t.replace("\t", ","), "its columns are separated by ',', and those of spam by tabs"),
            (lambda t: t.replace("\t", ";").replace(".", ","), "its columns are separated by ';'"),
            (lambda t: t.replace("\t", "  "), "its columns are separated by ' '"),
            (lambda t: "# made by hand\n" + t, "its first line begins with '# made by hand', and lacks"),
            (lambda t: t.replace(".", ","), "Label is '0,0000000' in row 1; save it with decimal points, not commas"),
            (lambda t: t.splitlines()[0] + "\n", "it holds no row: it is truncated"),
            (lambda t: t.replace("\n2.0000000\t", "\n2.0000001\t"), r"Label is 2\.0000001 in row 3"),
        ],
    )
    def test_tables_that_other_programs_have_saved(self, tmp_path, motions, change, message):
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        (tmp_path / "b.tsv").write_text(change((tmp_path / "a.tsv").read_text()))
        with pytest.raises(InputError, match=message) as error:
            read_ddic_tsv(tmp_path / "b.tsv", GRID)
        assert "\n" not in str(error.value)

    @pytest.mark.parametrize(
        "change",
        [
            lambda t: t.replace("\n", "\r\n"),
            lambda t: t.replace("\n", "\r"),
            lambda t: "\ufeff" + t,
            lambda t: t.replace("\n", "\n\n"),
            lambda t: t.replace("\n", "\t\n"),  # a tab at the end of each line
            lambda t: t.replace("\n", "\t\n").replace("\t\n", "\n", 1),  # of each row, but not of the header
            lambda t: t.replace("\t", " \t "),
            lambda t: t.replace("nan", "NaN"),
            lambda t: t.replace("nan", "-nan(ind)"),
            lambda t: "\n".join([t.splitlines()[0], *reversed(t.splitlines()[1:])]),
        ],
        ids=[
            "Windows",
            "old Mac",
            "byte order mark",
            "empty lines",
            "tabs",
            "tabs of rows",
            "spaces",
            "NaN",
            "NaN of Windows",
            "reversed",
        ],
    )
    def test_harmless_changes(self, tmp_path, motions, change):
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        (tmp_path / "b.tsv").write_bytes(change((tmp_path / "a.tsv").read_text()).encode())
        ours, theirs = (read_ddic_tsv(tmp_path / name, GRID) for name in ("a.tsv", "b.tsv"))
        rows = np.argsort(theirs.labels)
        np.testing.assert_array_equal(theirs.labels[rows], ours.labels)
        for name in ("centers", "translations", "rotations", "statuses"):
            np.testing.assert_array_equal(getattr(theirs, name)[rows], getattr(ours, name))

    def test_a_file_cut_anywhere_is_refused(self, tmp_path, motions):
        """But for the end of a row: the label image tells which are missing then."""
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        whole = (tmp_path / "a.tsv").read_bytes()
        for end in range(1, len(whole) - 1, 41):
            (tmp_path / "b.tsv").write_bytes(whole[:end])
            columns = whole[:end].rpartition(b"\n")[2].count(b"\t") + 1
            if columns == len(DDIC_COLUMNS + ADDED_COLUMNS) and end > len(whole.split(b"\n")[0]):
                continue  # within the last number, which is not used
            with pytest.raises(InputError, match=r"b\.tsv"):
                read_ddic_tsv(tmp_path / "b.tsv", GRID)

    def test_label_zero_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="label 0"):
            write_ddic_tsv(tmp_path / "a.tsv", Motions.identity(np.array([0]), np.zeros((1, 3))), GRID)

    def test_huge_labels_are_refused(self, tmp_path):
        with pytest.raises(InputError, match="the largest is 2000000, and spam wants a row for each"):
            write_ddic_tsv(tmp_path / "a.tsv", Motions.identity(np.array([2_000_000]), np.zeros((1, 3))), GRID)

    def test_labels_without_a_grain_of_the_motions_are_refused(self, tmp_path, motions):
        with pytest.raises(InputError, match=r"\[2, 3, 6\]"):
            write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, np.zeros(GRID.shape, int))


def l_shapes() -> np.ndarray:
    """Labels 2, 3 and 6, and 8 without a motion, each an L, whose box has its middle far from the centroid."""
    labels = np.zeros(GRID.shape, np.int32)
    for label, z in zip((2, 3, 6, 8), (3, 14, 25, 36)):
        labels[z : z + 8, 10:14, 20:40] = label
        labels[z : z + 4, 14:30, 20:26] = label
    return labels


def box_centers(labels: np.ndarray) -> np.ndarray:
    """Middles of the boxes of labels 2, 3 and 6, mm, x y z."""
    ends = [np.argwhere(labels == label)[:, ::-1] for label in (2, 3, 6)]
    return np.array([(e.min(axis=0) + e.max(axis=0)) / 2 for e in ends]) * GRID.voxel_size + GRID.origin


class TestPointOfTheDisplacement:
    """The displacement is that of the label's centroid, or of the middle of its bounding box."""

    @pytest.mark.parametrize("about", ["centroid", "box"])
    def test_displacement_is_that_of_the_named_point(self, tmp_path, motions, about):
        labels = l_shapes()
        centroids = [np.argwhere(labels == k).mean(axis=0)[::-1] * GRID.voxel_size + GRID.origin for k in (2, 3, 6)]
        point = np.array(centroids) if about == "centroid" else box_centers(labels)
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, labels, about=about)
        table = pd.read_csv(tmp_path / "a.tsv", sep="\t").loc[motions.labels]
        carried = apply_motion(motions.matrices, motions.translations, motions.centers, point)
        expected = (carried - point)[:, ::-1] / GRID.voxel_size
        np.testing.assert_allclose(table[["Zdisp", "Ydisp", "Xdisp"]], expected, atol=1e-6)
        positions = (np.array(centroids) - GRID.origin)[:, ::-1] / GRID.voxel_size
        np.testing.assert_allclose(table[["Zpos", "Ypos", "Xpos"]], positions, atol=1e-6)  # whatever the point

    @pytest.mark.parametrize("about", ["centroid", "box"])
    def test_motions_are_read_back_as_the_file_says(self, tmp_path, motions, about):
        labels = l_shapes()
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, labels, about=about)
        back = read_ddic_tsv(tmp_path / "a.tsv", GRID, labels)
        points = np.random.default_rng(0).normal(size=(3, 3))
        np.testing.assert_allclose(
            apply_motion(back.matrices[:3], back.translations[:3], back.centers[:3], points),
            apply_motion(motions.matrices, motions.translations, motions.centers, points),
            atol=2e-6,
        )

    def test_a_file_with_the_columns_of_spam_ddic_is_about_the_box(self, tmp_path, motions):
        labels = l_shapes()
        write_ddic_tsv(tmp_path / "ours.tsv", motions, GRID, labels, about="box")
        table = pd.read_csv(tmp_path / "ours.tsv", sep="\t")
        table[list(DDIC_COLUMNS)].to_csv(tmp_path / "ddic.tsv", sep="\t", index=False, na_rep="nan")
        ours, theirs = (read_ddic_tsv(tmp_path / f"{name}.tsv", GRID, labels) for name in ("ours", "ddic"))
        np.testing.assert_array_equal(theirs.translations, ours.translations)
        # spam's other programs have no column LabelDilate: their displacement is that of the position
        table[list(DDIC_COLUMNS[:-1])].to_csv(tmp_path / "other.tsv", sep="\t", index=False, na_rep="nan")
        other = read_ddic_tsv(tmp_path / "other.tsv", GRID, labels)
        as_told = read_ddic_tsv(tmp_path / "ddic.tsv", GRID, labels, about="centroid")
        np.testing.assert_array_equal(other.translations, as_told.translations)
        assert np.abs(other.translations - ours.translations)[:3].max() > GRID.voxel_size

    def test_without_labels_the_position_is_taken_for_the_middle_of_the_box(self, tmp_path, motions):
        labels = l_shapes()
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, labels, about="box")
        with_labels, without = (read_ddic_tsv(tmp_path / "a.tsv", GRID, given) for given in (labels, None))
        arms = box_centers(labels) - with_labels.centers[:3]
        error = np.einsum("nij,nj->ni", motions.matrices - np.eye(3), arms)
        np.testing.assert_allclose((without.translations - with_labels.translations)[:3], error, atol=1e-6)

    def test_the_box_needs_labels_to_be_written(self, tmp_path, motions):
        with pytest.raises(InputError, match="needs the labels"):
            write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, about="box")

    def test_unknown_points_are_refused(self, tmp_path, motions):
        with pytest.raises(InputError, match="'corner' is no point of a grain"):
            write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, about="corner")
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        with pytest.raises(InputError, match="'corner' is no point of a grain"):
            read_ddic_tsv(tmp_path / "a.tsv", GRID, about="corner")

    def test_rows_go_to_the_largest_label_of_the_image(self, tmp_path, motions):
        """spam-ddic compares positions with its own centroids of all labels, and NaN with NaN."""
        labels = l_shapes()
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, labels)
        table = pd.read_csv(tmp_path / "a.tsv", sep="\t")
        assert table["Label"].tolist() == list(range(9))
        for label in range(1, 9):
            there = np.argwhere(labels == label)
            expected = there.mean(axis=0) if len(there) else np.full(3, np.nan)
            np.testing.assert_allclose(table.loc[label, ["Zpos", "Ypos", "Xpos"]].to_numpy(float), expected, atol=1e-6)
        assert table.loc[8, "returnStatus"] == -7
        assert np.isnan(table.loc[8, "Zdisp"])


class TestStandardDeviations:
    def test_columns_are_of_the_written_point(self, tmp_path, motions):
        """Against the scatter of motions drawn from the covariance."""
        random = np.random.default_rng(8)
        root = random.normal(size=(3, 6, 6)) * np.array([2e-3] * 3 + [8e-3] * 3)[:, None]
        measured = replace(motions, covariances=root @ root.swapaxes(1, 2))
        write_ddic_tsv(tmp_path / "a.tsv", measured, GRID, l_shapes(), about="box")
        table = pd.read_csv(tmp_path / "a.tsv", sep="\t").loc[[2, 3, 6]]
        draws = np.einsum("nij,dnj->dni", root, random.normal(size=(20_000, 3, 6)))
        drawn = rotation_matrix(draws[..., 3:]) @ motions.matrices
        point = box_centers(l_shapes())
        carried = apply_motion(drawn, motions.translations + draws[..., :3], motions.centers, point)
        scatter = carried.std(axis=0)[:, ::-1] / GRID.voxel_size
        np.testing.assert_allclose(table[["sd_Zdisp", "sd_Ydisp", "sd_Xdisp"]], scatter, rtol=0.03)
        turns = np.rad2deg(draws[..., 3:].std(axis=0))[:, ::-1]
        np.testing.assert_allclose(table[["sd_Zrot_deg", "sd_Yrot_deg", "sd_Xrot_deg"]], turns, rtol=0.03)

    def test_variances_are_read_back(self, tmp_path, motions):
        sd = np.array([0.01, 0.02, 0.03, 0.004, 0.005, 0.006])
        write_ddic_tsv(tmp_path / "a.tsv", replace(motions, covariances=np.tile(np.diag(sd**2), (3, 1, 1))), GRID)
        back = read_ddic_tsv(tmp_path / "a.tsv", GRID)
        np.testing.assert_allclose(
            np.sqrt(np.diagonal(back.covariances, axis1=1, axis2=2)), np.tile(sd, (3, 1)), rtol=1e-5
        )


class TestReturnStatus:
    def test_status_says_what_may_be_used(self, tmp_path):
        n = len(Status)
        still = Motions.identity(np.arange(1, n + 1), np.zeros((n, 3)))
        statuses = np.array([s.value for s in Status], dtype="<U20")
        reasons = tuple("poorly determined: rotation" if s == "poorly-determined" else "" for s in statuses)
        gone = np.isin(statuses, ["left-field", "absent"])[:, None]
        told = replace(still, statuses=statuses, reasons=reasons, translations=np.where(gone, np.nan, np.zeros((n, 3))))
        write_ddic_tsv(tmp_path / "a.tsv", told, GRID)
        returned = dict(zip(statuses, pd.read_csv(tmp_path / "a.tsv", sep="\t")["returnStatus"][1:]))
        assert returned == {
            "converged": 2, "not-converged": -1, "poorly-determined": 1, "left-field": -7, "not-fitted": 0,
            "ambiguous": 1, "absent": -7, "cut": -1, "broken": -1, "deformed": -1,
        }  # fmt: skip

    @pytest.mark.parametrize(
        ("returned", "status", "moves", "words"),
        [
            (2, "converged", True, ""),
            (1, "not-converged", True, "limit of iterations"),
            (0, "not-fitted", True, "was not correlated"),
            (-1, "not-fitted", False, "diverged"),
            (-5, "not-fitted", False, "too small or outside"),
            (-7, "not-fitted", False, "is missing"),
            (-9, "not-fitted", False, "spam returned status -9"),
        ],
    )
    def test_meaning_of_what_spam_returns(self, tmp_path, motions, returned, status, moves, words):
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        table = pd.read_csv(tmp_path / "a.tsv", sep="\t")
        table["returnStatus"] = returned
        table.to_csv(tmp_path / "a.tsv", sep="\t", index=False)
        back = read_ddic_tsv(tmp_path / "a.tsv", GRID)
        assert set(back.statuses) == {status}
        assert np.isfinite(back.translations).all() == moves
        assert all(words in reason for reason in back.reasons)


class TestExchangedColumns:
    """spam-ddic -skp writes error, iterations, deltaPhiNorm and LabelDilate of repeated grains one column off."""

    @pytest.mark.parametrize(
        ("column", "value", "words"),
        [
            ("iterations", 0.0312, "iterations is 0.0312 in row 4"),
            ("iterations", np.inf, "iterations is inf in row 4"),
            ("LabelDilate", 0.0007, "LabelDilate is 0.0007 in row 4"),
            ("returnStatus", 0.5, "returnStatus is 0.5 in row 4"),
        ],
    )
    def test_are_refused_with_the_reason(self, tmp_path, motions, column, value, words):
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        table = pd.read_csv(tmp_path / "a.tsv", sep="\t")
        table[column] = table[column].astype(float)
        table.loc[3, column] = value
        table.to_csv(tmp_path / "a.tsv", sep="\t", index=False)
        with pytest.raises(InputError, match=words) as error:
            read_ddic_tsv(tmp_path / "a.tsv", GRID)
        assert "-skp" in str(error.value)


def test_file_of_other_voxels_is_refused(tmp_path, motions):
    write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
    with pytest.raises(InputError, match=r"voxels of 0\.05 mm .* voxels of 0\.1"):
        read_ddic_tsv(tmp_path / "a.tsv", Volume.zeros((24, 26, 28), 0.1, GRID.center))


class TestGradientsThatAreNoRotations:
    @pytest.mark.parametrize(
        ("gradient", "status", "words"),
        [
            (np.diag([1.0, 1.0, -1.0]), Status.NOT_FITTED, "mirrored"),
            (np.zeros((3, 3)), Status.NOT_FITTED, "singular (rank 0)"),
            (np.diag([1.0, 0.0, 0.0]), Status.NOT_FITTED, "singular (rank 1)"),
            (np.diag([1.3, 1.0, 1.0]), Status.NOT_CONVERGED, "strains by 30%"),
            (np.diag([1.05, 1.0, 0.97]), Status.CONVERGED, ""),
        ],
    )
    def test_status_and_reason(self, tmp_path, motions, gradient, status, words):
        write_ddic_tsv(tmp_path / "a.tsv", motions, GRID)
        table = pd.read_csv(tmp_path / "a.tsv", sep="\t")
        table.loc[2, list(GRADIENT)] = gradient.ravel()
        table.loc[2, "returnStatus"] = 2
        table.to_csv(tmp_path / "a.tsv", sep="\t", index=False)
        read = read_ddic_tsv(tmp_path / "a.tsv", GRID)
        assert read.statuses[0] == status.value
        assert words in read.reasons[0]
        assert np.isfinite(read.rotations[0]).all() == (status != Status.NOT_FITTED)


def test_gradients_of_strained_grains_hold_the_strain(tmp_path, motions):
    """spam's F is Ω U; its rotation is read back, and a carried point is where the whole F puts it."""
    strains = np.array([[0.05, -0.02, 0.0, 0.01, 0.0, 0.03]] * 3)
    strained = replace(motions, strains=strains, strain_covariances=np.zeros((3, 6, 6)))
    write_ddic_tsv(tmp_path / "a.tsv", strained, GRID)
    table = pd.read_csv(tmp_path / "a.tsv", sep="\t").set_index("Label")
    written = table.loc[motions.labels, list(GRADIENT)].to_numpy().reshape(3, 3, 3)[:, ::-1, ::-1]
    np.testing.assert_allclose(written, strained.gradients, atol=1e-7)
    np.testing.assert_allclose(read_ddic_tsv(tmp_path / "a.tsv", GRID).matrices, motions.matrices, atol=2e-7)
