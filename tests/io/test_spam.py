"""Exchange of motions with spam: round trip of the TSV format, and tests marked `spam` that run spam itself."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tifffile
from scipy import ndimage

from grainmotion.analysis.deformed_volume import rebuild
from grainmotion.errors import InputError
from grainmotion.io.spam import DDIC_COLUMNS, GRADIENT, read_ddic_tsv, write_ddic_tsv
from grainmotion.model.motions import Motions, Status
from grainmotion.model.volume import Volume
from grainmotion.rotations import apply_motion, recenter
from grainmotion.segmentation.extraction import grains_from_labels

GRID = Volume.zeros((48, 52, 56), 0.05, (0.3, -0.2, 1.0))
ROOT = Path(__file__).parents[2]


def converged(labels: list[int], centers: np.ndarray, u: np.ndarray, degrees: np.ndarray) -> Motions:
    """Converged motions with translations u (mm) and rotation vectors in degrees."""
    n = len(labels)
    return replace(
        Motions.identity(np.array(labels), centers),
        translations=u,
        rotations=np.deg2rad(degrees),
        statuses=np.full(n, "converged", dtype="<U20"),
        residuals=np.linspace(0.01, 0.02, n),
        iterations=np.arange(5, 5 + n),
    )


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
        np.testing.assert_allclose(back.residuals, motions.residuals, rtol=1e-8)
        np.testing.assert_allclose(back.centers, motions.centers, atol=1e-8)
        np.testing.assert_allclose(back.translations, motions.translations, atol=1e-8)
        np.testing.assert_allclose(back.matrices, motions.matrices, atol=1e-8)

    def test_unknown_motions_become_not_fitted(self, tmp_path, motions):
        unknown = np.where(np.arange(3)[:, None] == 1, np.nan, motions.translations)
        statuses = np.array(["converged", "left-field", "not-converged"], dtype="<U20")
        write_ddic_tsv(tmp_path / "a.tsv", replace(motions, translations=unknown, statuses=statuses), GRID)
        back = read_ddic_tsv(tmp_path / "a.tsv", GRID)
        assert list(back.statuses) == ["converged", "not-fitted", "not-converged"]
        assert np.isnan(back.translations[1]).all()
        assert np.isnan(back.rotations[1]).all()
        assert back.reasons[0] == ""
        assert "status -7" in back.reasons[1]

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
        assert tuple(lines[0].split("\t")) == DDIC_COLUMNS
        rows = [dict(zip(DDIC_COLUMNS, map(float, line.split("\t")))) for line in lines[1:]]
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
            atol=1e-7,
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
        np.testing.assert_allclose(read_ddic_tsv(tmp_path / "b.tsv", GRID).matrices, motions.matrices, atol=1e-8)


class TestBadInput:
    def test_missing_file_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="no such file"):
            read_ddic_tsv(tmp_path / "none.tsv", GRID)

    @pytest.mark.parametrize(
        ("text", "fact"),
        [
            ("Label\tZpos\n1\t2\n", "columns .* are missing"),
            ("NodeNumber\tZpos\n1\t2\n", "NodeNumber"),
            ("\t".join(DDIC_COLUMNS) + "\n" + "\t".join(["1"] * 21 + ["x"]) + "\n", None),
            (
                "\t".join(DDIC_COLUMNS) + "\n" + "\t".join(["1", "two"] + ["1"] * 20) + "\n",
                "Zpos is 'two' in row 1",
            ),
            ("\t".join(DDIC_COLUMNS) + "\n" + 2 * ("\t".join(["1"] * 22) + "\n"), "given twice"),
            ("\x00\x01", "missing|no table"),
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

    def test_label_zero_is_refused(self, tmp_path):
        with pytest.raises(InputError, match="label 0"):
            write_ddic_tsv(tmp_path / "a.tsv", Motions.identity(np.array([0]), np.zeros((1, 3))), GRID)

    def test_labels_without_a_grain_of_the_motions_are_refused(self, tmp_path, motions):
        with pytest.raises(InputError, match=r"\[2, 3, 6\]"):
            write_ddic_tsv(tmp_path / "a.tsv", motions, GRID, np.zeros(GRID.shape, int))


# ---------------------------------------------------------------------- spam itself
@pytest.fixture(scope="module")
def spam_python() -> Path:
    """The Python of an environment that holds spam."""
    python = Path(os.environ.get("GRAINMOTION_SPAM_PYTHON", ROOT / ".venv-spam" / "bin" / "python"))
    if not python.exists():
        pytest.fail(
            f"{python} is missing: run `python -m venv .venv-spam && .venv-spam/bin/pip install spam`, "
            "or let GRAINMOTION_SPAM_PYTHON name the Python of an environment that holds spam"
        )
    return python


def run_in_spam(python: Path, script: str, *arguments: object) -> dict:
    """Run a script in spam's environment; its last line is JSON."""
    command = [str(python), "-c", script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


READ = """
import json, sys, numpy, spam.deformation, spam.helpers
table = spam.helpers.readCorrelationTSV(sys.argv[1], readError=True, verbose=False)
vectors = [spam.deformation.decomposePhi(phi)["r"] for phi in table["PhiField"]]
keys = ("fieldCoords", "PhiField", "returnStatus", "iterations", "error")
print(json.dumps({**{k: numpy.asarray(table[k]).tolist() for k in keys}, "r": numpy.array(vectors).tolist()}))
"""

MOVE = """
import json, sys, numpy, tifffile, spam.helpers, spam.label
table = spam.helpers.readCorrelationTSV(sys.argv[1], verbose=False)
labels = tifffile.imread(sys.argv[2])
moved = spam.label.moveLabels(
    labels, table["PhiField"], returnStatuses=table["returnStatus"], margin=12, nProcesses=1
)
tifffile.imwrite(sys.argv[3], moved)
print(json.dumps({}))
"""


@pytest.fixture(scope="module")
def packing() -> tuple[Volume, np.ndarray, Motions]:
    """Three textured ellipsoids with labels 1, 2 and 4, and their motion to another state."""
    random = np.random.default_rng(5)
    z, y, x = np.meshgrid(*(np.arange(n) for n in GRID.shape), indexing="ij")
    texture = 1 + 0.5 * ndimage.gaussian_filter(random.normal(size=GRID.shape), 1.5) / 0.12
    labels = np.zeros(GRID.shape, np.int32)
    for label, (cz, cy, cx) in {1: (14, 16, 16), 2: (32, 36, 18), 4: (24, 22, 40)}.items():
        labels[((z - cz) / 8) ** 2 + ((y - cy) / 10) ** 2 + ((x - cx) / 9) ** 2 < 1] = label
    volume = Volume(ndimage.gaussian_filter(np.where(labels > 0, texture, 0), 0.7), GRID.voxel_size, GRID.center)
    grains = grains_from_labels(volume, labels)
    u = random.uniform(-2.5, 2.5, (3, 3)) * GRID.voxel_size
    return volume, labels, converged([1, 2, 4], grains.centers, u, random.uniform(-9, 9, (3, 3)))


@pytest.mark.spam
class TestWithSpam:
    def test_spam_reads_the_same_motions(self, tmp_path, motions, spam_python):
        small = replace(motions, rotations=motions.rotations / 4)
        write_ddic_tsv(tmp_path / "a-ddic.tsv", small, GRID)
        read = {k: np.array(v) for k, v in run_in_spam(spam_python, READ, tmp_path / "a-ddic.tsv").items()}
        voxels = (small.centers - GRID.origin)[:, ::-1] / GRID.voxel_size
        np.testing.assert_allclose(read["fieldCoords"][small.labels], voxels, atol=1e-7)
        phi = read["PhiField"][small.labels]
        np.testing.assert_allclose(phi[:, :3, 3], small.translations[:, ::-1] / GRID.voxel_size, atol=1e-7)
        np.testing.assert_allclose(phi[:, :3, :3], small.matrices[:, ::-1, ::-1], atol=1e-7)
        # Reversing the axes mirrors the frame: spam's rotation vector is minus ours, reversed.
        np.testing.assert_allclose(read["r"][small.labels], -np.rad2deg(small.rotations)[:, ::-1], atol=1e-5)
        np.testing.assert_array_equal(read["returnStatus"][small.labels], 2)
        np.testing.assert_array_equal(read["iterations"][small.labels], small.iterations)
        np.testing.assert_allclose(read["error"][small.labels], small.residuals, rtol=1e-7)

    def test_labels_moved_by_spam_overlap_those_of_rebuild(self, tmp_path, packing, spam_python):
        _, labels, motions = packing
        tifffile.imwrite(tmp_path / "labels.tif", labels.astype("<u4"))
        write_ddic_tsv(tmp_path / "a-ddic.tsv", motions, GRID, labels)
        run_in_spam(spam_python, MOVE, tmp_path / "a-ddic.tsv", tmp_path / "labels.tif", tmp_path / "moved.tif")
        theirs = tifffile.imread(tmp_path / "moved.tif")
        body = Volume((labels > 0).astype(np.float32), GRID.voxel_size, GRID.center)
        _, ours = rebuild(grains_from_labels(body, labels, reach=0), about_centres_of(motions, body, labels), GRID)
        for label in (1, 2, 4):
            both, either = (theirs == label) & (ours == label), (theirs == label) | (ours == label)
            assert both.sum() / either.sum() > 0.97

    def test_spam_ddic_started_from_our_file_agrees(self, tmp_path, packing, spam_python):
        """spam-ddic on reference and deformed volume, started 0.4 voxel away, converges to our motions."""
        volume, labels, motions = packing
        moved, _ = rebuild(grains_from_labels(volume, labels), motions, GRID)
        tifffile.imwrite(tmp_path / "reference.tif", volume.array)
        tifffile.imwrite(tmp_path / "labels.tif", labels.astype("<u4"))
        tifffile.imwrite(tmp_path / "moved.tif", moved.array)
        start = replace(motions, translations=motions.translations + 0.4 * GRID.voxel_size)
        write_ddic_tsv(tmp_path / "start.tsv", start, GRID, labels)
        command = [spam_python.parent / "spam-ddic", "-np", "1", "-pf", tmp_path / "start.tsv"]
        command += ["-od", tmp_path, "-pre", "spam"]
        command += [tmp_path / name for name in ("reference.tif", "labels.tif", "moved.tif")]
        done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=900)
        assert (tmp_path / "spam-ddic.tsv").exists(), done.stdout + done.stderr
        correlated = read_ddic_tsv(tmp_path / "spam-ddic.tsv", GRID)
        np.testing.assert_array_equal(correlated.labels, motions.labels)
        assert set(correlated.statuses) == {"converged"}
        translations = recenter(correlated.matrices, correlated.translations, correlated.centers, motions.centers)
        np.testing.assert_allclose(translations, motions.translations, atol=0.05 * GRID.voxel_size)
        np.testing.assert_allclose(np.rad2deg(correlated.rotations), np.rad2deg(motions.rotations), atol=0.3)


def about_centres_of(motions: Motions, body: Volume, labels: np.ndarray) -> Motions:
    """The same motions about the centres of grains of uniform attenuation."""
    centers = grains_from_labels(body, labels, reach=0).centers
    moved = recenter(motions.matrices, motions.translations, motions.centers, centers)
    return replace(motions, centers=centers, translations=moved)


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
    np.testing.assert_allclose(written, strained.gradients, atol=1e-8)
    np.testing.assert_allclose(read_ddic_tsv(tmp_path / "a.tsv", GRID).matrices, motions.matrices, atol=1e-8)
