"""Files that spam itself reads, moves labels by, strains, and writes; marked `spam`, run by `make test-spam`."""

from __future__ import annotations

import json
import os
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tifffile
from scipy import ndimage

from converged_motions import converged
from grainmotion.analysis.deformed_volume import rebuild
from grainmotion.errors import InputError
from grainmotion.io.spam import read_ddic_tsv, write_ddic_tsv
from grainmotion.io.spam_table import DDIC_COLUMNS, GRADIENT
from grainmotion.io.volumes.access import write_volume
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.projection.grains import simulate_radiographs
from grainmotion.rotations import apply_motion, recenter, rotation_matrix
from grainmotion.segmentation.extraction import grains_from_labels
from grainmotion.tracking.track import TrackSettings, track

pytestmark = pytest.mark.spam
GRID = Volume.zeros((48, 52, 56), 0.05, (0.3, -0.2, 1.0))
ROOT = Path(__file__).parents[2]
LABELS = (1, 2, 4)


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


def run_program(*command: object) -> None:
    """Run one of spam's programs."""
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stdout + done.stderr


READ = """
import json, sys, numpy, spam.deformation, spam.helpers
table = spam.helpers.readCorrelationTSV(sys.argv[1], readError=True, readPixelSearchCC=True, verbose=False)
vectors = [spam.deformation.decomposePhi(phi)["r"] for phi in table["PhiField"]]
keys = ("fieldCoords", "PhiField", "returnStatus", "iterations", "error", "pixelSearchCC")
print(json.dumps({**{k: numpy.asarray(table[k]).tolist() for k in keys}, "r": numpy.array(vectors).tolist()}))
"""


def lump(at: tuple[int, int, int], bump: tuple[int, int, int]) -> np.ndarray:
    """A ball of radius 7 with a bump to one side: the middle of its box is over a voxel off its centroid."""
    z, y, x = np.meshgrid(*(np.arange(n) for n in GRID.shape), indexing="ij")
    inside = np.zeros(GRID.shape, dtype=bool)
    for place, radius in ((at, 7), (tuple(np.add(at, bump)), 4)):
        inside |= (z - place[0]) ** 2 + (y - place[1]) ** 2 + (x - place[2]) ** 2 < radius**2
    return inside


@pytest.fixture(scope="module")
def packing() -> tuple[Volume, np.ndarray, Motions]:
    """Three textured lumps with labels 1, 2 and 4, and their motion to another state."""
    random = np.random.default_rng(5)
    texture = 1 + 0.5 * ndimage.gaussian_filter(random.normal(size=GRID.shape), 1.5) / 0.12
    labels = np.zeros(GRID.shape, np.int32)
    for label, (at, bump) in zip(
        LABELS, (((14, 16, 16), (7, 6, 5)), ((32, 36, 18), (-6, -7, 5)), ((24, 22, 40), (7, 5, -6)))
    ):
        labels[lump(at, bump)] = label
    volume = Volume(ndimage.gaussian_filter(np.where(labels > 0, texture, 0), 0.7), GRID.voxel_size, GRID.center)
    grains = grains_from_labels(volume, labels)
    u = random.uniform(-2.5, 2.5, (3, 3)) * GRID.voxel_size
    degrees = np.array([[19.0, -14.0, 9.0], [-10.0, 18.0, 15.0], [12.0, 10.0, -21.0]])
    return volume, labels, converged(LABELS, grains.centers, u, degrees)


def centroids(labels: np.ndarray) -> np.ndarray:
    """Of the three labels, voxels, x y z."""
    present = [k for k in LABELS if (labels == k).any()]
    return np.array([np.argwhere(labels == k).mean(axis=0)[::-1] for k in present])


def box_centers(labels: np.ndarray) -> np.ndarray:
    """Middles of their bounding boxes, voxels, x y z."""
    places = [np.argwhere(labels == k)[:, ::-1] for k in LABELS]
    return np.array([(p.min(axis=0) + p.max(axis=0)) / 2 for p in places])


def carried(motions: Motions, voxels: np.ndarray) -> np.ndarray:
    """Displacement of one point a grain, voxels, x y z."""
    points = GRID.origin + voxels * GRID.voxel_size
    moved = apply_motion(motions.matrices, motions.translations, motions.centers, points)
    return (moved - points) / GRID.voxel_size


def turned(motions: Motions, arms: np.ndarray) -> np.ndarray:
    """(R − 1) arm of each grain."""
    return np.einsum("nij,nj->ni", motions.matrices - np.eye(3), arms)


@pytest.mark.parametrize("about", ["centroid", "box"])
def test_spam_reads_the_same_motions(tmp_path, packing, spam_python, about):
    _, labels, motions = packing
    write_ddic_tsv(tmp_path / "a-ddic.tsv", motions, GRID, labels, about=about)
    read = {k: np.array(v) for k, v in run_in_spam(spam_python, READ, tmp_path / "a-ddic.tsv").items()}
    rows = list(LABELS)
    np.testing.assert_allclose(read["fieldCoords"][rows], centroids(labels)[:, ::-1], atol=1e-6)
    point = centroids(labels) if about == "centroid" else box_centers(labels)
    np.testing.assert_allclose(read["PhiField"][rows, :3, 3], carried(motions, point)[:, ::-1], atol=1e-6)
    np.testing.assert_allclose(read["PhiField"][rows, :3, :3], motions.matrices[:, ::-1, ::-1], atol=1e-7)
    np.testing.assert_array_equal(read["PhiField"][0], np.eye(4))
    assert np.isnan(read["fieldCoords"][3]).all()  # a gap
    # Reversing the axes mirrors the frame: spam's rotation vector is minus ours, reversed.
    np.testing.assert_allclose(read["r"][rows], -np.rad2deg(motions.rotations)[:, ::-1], atol=1e-4)
    np.testing.assert_array_equal(read["returnStatus"], [0, 2, 2, -7, 2])
    np.testing.assert_array_equal(read["iterations"][rows], motions.iterations)
    np.testing.assert_allclose(read["error"][rows], motions.residuals, atol=1e-7)
    np.testing.assert_array_equal(read["pixelSearchCC"], 0)


class TestMoveLabels:
    """The script spam-moveLabels: which point of a grain does it take the displacement for?"""

    def moved(self, tmp_path, packing, spam_python, about, *options):
        """The labels that the script has moved."""
        volume, labels, motions = packing
        write_volume(tmp_path / "reference.tif", volume, labels=labels)  # the files of the export
        write_ddic_tsv(tmp_path / "a-ddic.tsv", motions, GRID, labels, about=about)
        command = [spam_python.parent / "spam-moveLabels", "-pf", tmp_path / "a-ddic.tsv", "-pre", "moved", "-np", "1"]
        run_program(*command, "-lm", "8", *options, tmp_path / "reference_labels.tif")
        return tifffile.imread(tmp_path / "moved.tif")

    def test_with_com_it_is_the_centroid(self, tmp_path, packing, spam_python):
        _, labels, motions = packing
        moved = self.moved(tmp_path, packing, spam_python, "centroid", "-com")
        shift = centroids(moved) - centroids(labels)
        np.testing.assert_allclose(shift, carried(motions, centroids(labels)), atol=0.06)
        body = Volume((labels > 0).astype(np.float32), GRID.voxel_size, GRID.center)
        grains = grains_from_labels(body, labels, reach=0)
        here = recenter(motions.matrices, motions.translations, motions.centers, grains.centers)
        _, ours = rebuild(grains, replace(motions, centers=grains.centers, translations=here), GRID)
        for label in LABELS:
            both, either = (moved == label) & (ours == label), (moved == label) | (ours == label)
            assert both.sum() / either.sum() > 0.97

    def test_with_com_a_file_about_the_box_is_wrong(self, tmp_path, packing, spam_python):
        _, labels, motions = packing
        shift = centroids(self.moved(tmp_path, packing, spam_python, "box", "-com")) - centroids(labels)
        error = turned(motions, box_centers(labels) - centroids(labels))
        assert np.abs(error).max() > 0.25
        np.testing.assert_allclose(shift - carried(motions, centroids(labels)), error, atol=0.06)

    def test_without_com_it_is_the_centroid_rounded_down(self, tmp_path, packing, spam_python):
        """Neither the centroid nor the middle of the box, of which its help speaks."""
        _, labels, motions = packing
        shift = centroids(self.moved(tmp_path, packing, spam_python, "centroid")) - centroids(labels)
        error = turned(motions, centroids(labels) - np.floor(centroids(labels)))
        assert np.abs(error).max() > 0.12
        np.testing.assert_allclose(shift - carried(motions, centroids(labels)), error, atol=0.06)

    def test_grains_that_did_not_converge_stay_out(self, tmp_path, packing, spam_python):
        volume, labels, motions = packing
        statuses = np.array(["converged", "ambiguous", "not-converged"], dtype="<U20")
        other = volume, labels, replace(motions, statuses=statuses)
        moved = self.moved(tmp_path, other, spam_python, "centroid", "-com")
        assert set(np.unique(moved)) == {0, 1}
        moved = self.moved(tmp_path, other, spam_python, "centroid", "-com", "-rst", "1")
        assert set(np.unique(moved)) == {0, 1, 2}


@pytest.fixture(scope="module")
def correlated(packing, spam_python, tmp_path_factory) -> Path:
    """What spam-ddic writes on reference and deformed volume, started 0.4 voxel away from our file."""
    folder = tmp_path_factory.mktemp("ddic")
    volume, labels, motions = packing
    moved, _ = rebuild(grains_from_labels(volume, labels), motions, GRID)
    write_volume(folder / "reference.tif", volume, labels=labels)
    write_volume(folder / "moved.tif", moved)
    start = replace(motions, translations=motions.translations + 0.4 * GRID.voxel_size)
    write_ddic_tsv(folder / "start.tsv", start, GRID, labels, about="box")
    correlate(spam_python, folder, folder / "start.tsv", "-pre", "first")
    return folder


def correlate(python: Path, folder: Path, start: Path, *options: str) -> None:
    command = [python.parent / "spam-ddic", "-np", "1", "-pf", start, "-od", folder, *options]
    run_program(*command, *(folder / name for name in ("reference.tif", "reference_labels.tif", "moved.tif")))


class TestDdic:
    def test_its_columns_are_as_named(self, correlated):
        header, *rows = (correlated / "first-ddic.tsv").read_text().splitlines()
        assert tuple(header.split("\t")) == DDIC_COLUMNS
        assert len(rows) == 5

    def test_started_from_our_file_it_agrees(self, correlated, packing):
        _, labels, motions = packing
        found = read_ddic_tsv(correlated / "first-ddic.tsv", GRID, labels)
        np.testing.assert_array_equal(found.labels, motions.labels)
        assert set(found.statuses) == {"converged"}
        translations = recenter(found.matrices, found.translations, found.centers, motions.centers)
        np.testing.assert_allclose(translations, motions.translations, atol=0.05 * GRID.voxel_size)
        np.testing.assert_allclose(np.rad2deg(found.rotations), np.rad2deg(motions.rotations), atol=0.3)

    def test_its_displacement_is_that_of_the_middle_of_the_box(self, correlated, packing):
        _, labels, motions = packing
        table = pd.read_csv(correlated / "first-ddic.tsv", sep="\t").loc[list(LABELS)]
        np.testing.assert_allclose(table[["Zpos", "Ypos", "Xpos"]], centroids(labels)[:, ::-1], atol=1e-3)
        written = table[["Xdisp", "Ydisp", "Zdisp"]].to_numpy()
        np.testing.assert_allclose(written, carried(motions, box_centers(labels)), atol=0.05)
        assert np.abs(written - carried(motions, centroids(labels))).max() > 0.25

    def test_a_state_is_tracked_from_its_file(self, correlated, packing):
        volume, labels, motions = packing
        grains = grains_from_labels(volume, labels)
        views = Geometry.parallel([0.0, 45.0, 90.0, 135.0], (60, 90), GRID.voxel_size)
        scan = Scan(simulate_radiographs(grains, motions, views), views)
        start = read_ddic_tsv(correlated / "first-ddic.tsv", GRID, labels)
        settings = TrackSettings(search=False, fields=False)
        found = track(grains, scan, initial=start, settings=settings)
        errors = np.abs(found.translations - motions.translations) / GRID.voxel_size
        assert errors.max() < 0.02
        assert np.rad2deg(np.abs(found.rotations - motions.rotations)).max() < 0.2

    def test_a_file_of_repeated_grains_is_refused(self, correlated, packing, spam_python):
        """spam-ddic -skp on one grain that had not converged."""
        table = pd.read_csv(correlated / "first-ddic.tsv", sep="\t")
        table.loc[2, "returnStatus"] = 1
        table.to_csv(correlated / "again.tsv", sep="\t", index=False, na_rep="nan")
        correlate(spam_python, correlated, correlated / "again.tsv", "-skp", "-pre", "again")
        with pytest.raises(InputError, match=r"in row 3, no whole number: spam-ddic -skp"):
            read_ddic_tsv(correlated / "again-ddic.tsv", GRID)


@pytest.fixture(scope="module")
def searched(packing, spam_python, tmp_path_factory) -> tuple[Path, Motions]:
    """What they write: of the sample as a whole, of each grain from there, and filtered."""
    folder = tmp_path_factory.mktemp("search")
    volume, labels, motions = packing
    true = replace(motions, rotations=motions.rotations / 4)
    moved, _ = rebuild(grains_from_labels(volume, labels), true, GRID)
    write_volume(folder / "reference.tif", volume, labels=labels)
    write_volume(folder / "moved.tif", moved)
    images = folder / "reference.tif", folder / "moved.tif"
    programs = spam_python.parent
    run_program(programs / "spam-reg", "-bb", "1", "-be", "1", "-od", folder, "-pre", "whole", *images)
    search = [programs / "spam-pixelSearch", "-np", "1", "-lab1", folder / "reference_labels.tif"]
    turned = ["-pf", folder / "whole-registration.tsv", "-F", "all"]
    run_program(*search, *turned, "-sr", *["-4", "4"] * 3, "-od", folder, "-pre", "each", *images)
    correlate(spam_python, folder, folder / "each-pixelSearch.tsv", "-pre", "last")
    return folder, true


class TestSearch:
    """spam-reg, spam-pixelSearch and spam-filterPhiField on a pair whose grains turned little."""

    def test_a_file_of_the_whole_sample_is_refused(self, searched):
        with pytest.raises(
            InputError, match=r"NodeNumber.*spam-passPhiField -pf FILE -lab1 LABELS makes one of grains"
        ):
            read_ddic_tsv(searched[0] / "whole-registration.tsv", GRID)

    def test_a_pixel_search_is_about_centroids_and_a_start(self, searched, packing):
        folder, true = searched
        _, labels, _ = packing
        found = read_ddic_tsv(folder / "each-pixelSearch.tsv", GRID, labels)
        assert set(found.statuses) == {"not-converged"}
        assert "a guess of another program than spam-ddic, as of a pixel search" in found.reasons[0]
        translations = recenter(found.matrices, found.translations, found.centers, true.centers)
        np.testing.assert_allclose(translations, true.translations, atol=0.75 * GRID.voxel_size)  # whole voxels
        header = (folder / "each-pixelSearch.tsv").read_text().split("\n")[0].split("\t")
        assert {"pixelSearchCC", "returnStatus"} <= set(header)
        assert not {"PSCC", "LabelDilate"} & set(header)

    def test_spam_ddic_started_from_it_finds_the_motions(self, searched, packing):
        folder, true = searched
        found = read_ddic_tsv(folder / "last-ddic.tsv", GRID, packing[1])
        assert set(found.statuses) == {"converged"}
        translations = recenter(found.matrices, found.translations, found.centers, true.centers)
        np.testing.assert_allclose(translations, true.translations, atol=0.05 * GRID.voxel_size)

    def test_written_again_it_is_the_same(self, searched, packing, tmp_path):
        """spam's file, read by us, written by us, read by spam's own reader: each number of a grain."""
        _, labels, _ = packing
        table = pd.read_csv(searched[0] / "last-ddic.tsv", sep="\t").loc[list(LABELS)]
        write_ddic_tsv(
            tmp_path / "a.tsv", read_ddic_tsv(searched[0] / "last-ddic.tsv", GRID, labels), GRID, labels, about="box"
        )
        ours = pd.read_csv(tmp_path / "a.tsv", sep="\t").loc[list(LABELS)]
        for column in DDIC_COLUMNS[:7]:
            np.testing.assert_allclose(ours[column], table[column], atol=2e-6, err_msg=column)
        theirs, back = (t[list(GRADIENT)].to_numpy().reshape(-1, 3, 3) for t in (table, ours))
        stretch = np.linalg.inv(back) @ theirs  # the rotation of F is kept, and no strain
        np.testing.assert_allclose(stretch, stretch.swapaxes(1, 2), atol=2e-6)
        np.testing.assert_array_equal(ours["returnStatus"], table["returnStatus"])

    def test_a_filtered_file_keeps_the_boxes_of_its_source(self, searched, packing, spam_python):
        """One of three was bad and is interpolated; the others keep their displacement: name the point by `about`."""
        folder, _ = searched
        table = pd.read_csv(folder / "last-ddic.tsv", sep="\t")
        table.loc[2, "returnStatus"] = -1
        table.to_csv(folder / "bad.tsv", sep="\t", index=False, na_rep="nan")
        options = "-srs", "-srst", "1", "-cint", "-F", "no", "-nn", "2", "-np", "1"
        run_program(spam_python.parent / "spam-filterPhiField", "-pf", folder / "bad.tsv", *options, "-od", folder)
        source = read_ddic_tsv(folder / "last-ddic.tsv", GRID, packing[1])
        filtered = read_ddic_tsv(folder / "bad-filtered.tsv", GRID, packing[1], about="box")
        assert list(filtered.statuses) == ["converged", "not-converged", "converged"]
        np.testing.assert_allclose(filtered.translations[[0, 2]], source.translations[[0, 2]], atol=1e-6)


def test_files_of_other_programs_are_about_centroids(tmp_path, packing, spam_python):
    """spam-passPhiField has its own columns in its own order; each label takes the motion of the nearest, its own."""
    _, labels, motions = packing
    dense = np.where(labels == 4, 3, labels)  # it takes no gaps
    renumbered = replace(motions, labels=np.array([1, 2, 3]))
    tifffile.imwrite(tmp_path / "labels.tif", dense.astype("<u4"))
    write_ddic_tsv(tmp_path / "a-ddic.tsv", renumbered, GRID, dense)
    command = [spam_python.parent / "spam-passPhiField", "-pf", tmp_path / "a-ddic.tsv", "-nn", "1", "-rst", "2"]
    run_program(*command, "-lab1", tmp_path / "labels.tif", "-od", tmp_path, "-pre", "onto", "-np", "1")
    written = next(tmp_path.glob("onto*.tsv"))
    assert tuple(written.read_text().split("\n")[0].split("\t")[4:8]) == ("Fzz", "Fzy", "Fzx", "Zdisp")
    back = read_ddic_tsv(written, GRID, dense)
    np.testing.assert_allclose(back.matrices, motions.matrices, atol=1e-5)
    points = motions.centers + 0.1
    ours, theirs = (apply_motion(m.matrices, m.translations, m.centers, points) for m in (motions, back))
    np.testing.assert_allclose(theirs, ours, atol=1e-5)


PAGE = (ROOT / "docs" / "how-to" / "from-spam.md").read_text()
LINE = next(code for code in re.findall(r"^python -c '(.*)'$", PAGE, re.MULTILINE) if "FfieldBagi" in code)
"""The recipe of the documentation, in one line; it writes two files into the folder in which it is run."""
STRAIN = f"""
import json, os, sys
path = sys.argv[1]
os.chdir(os.path.dirname(path))
{LINE.replace('"results/step-01/grains-ddic.tsv"', "path")}
written = np.loadtxt("strains.csv", delimiter=",", ndmin=2, skiprows=1)
print(json.dumps({{"F": np.load("F.npy").tolist(), "vol": written[:, 0].tolist()}}))
"""


class TestStrain:
    GRADIENT = np.array([[0.02, 0.03, 0.0], [-0.01, -0.05, 0.02], [0.0, 0.015, 0.04]])  # of u, x y z

    @pytest.fixture
    def stretched(self) -> tuple[np.ndarray, Motions]:
        """27 lumps whose centroids move affinely, each turned in its own way about another point."""
        labels, random = np.zeros(GRID.shape, np.int32), np.random.default_rng(3)
        for k, corner in enumerate(np.stack(np.meshgrid(*[[4, 19, 34]] * 3), axis=-1).reshape(-1, 3), start=1):
            z, y, x = corner + random.integers(0, 4, 3)
            labels[z : z + 8, y : y + 3, x : x + 8] = k
            labels[z : z + 3, y : y + 8, x : x + 3] = k
        numbers = tuple(range(1, 28))
        middles = np.array([np.argwhere(labels == k).mean(axis=0)[::-1] for k in numbers])
        middles = GRID.origin + middles * GRID.voxel_size
        other = middles + random.normal(scale=0.1, size=middles.shape)
        degrees = random.normal(scale=15, size=middles.shape)
        u = recenter(rotation_matrix(np.deg2rad(degrees)), middles @ self.GRADIENT.T, middles, other)
        return labels, converged(numbers, other, u, degrees)

    def test_spam_finds_the_strain_from_centroids(self, tmp_path, stretched, spam_python):
        labels, motions = stretched
        write_ddic_tsv(tmp_path / "a-ddic.tsv", motions, GRID, labels)
        found = {k: np.array(v) for k, v in run_in_spam(spam_python, STRAIN, tmp_path / "a-ddic.tsv").items()}
        expected = np.eye(3) + self.GRADIENT
        assert len(found["F"]) > 50
        np.testing.assert_allclose(found["F"], np.tile(expected[::-1, ::-1], (len(found["F"]), 1, 1)), atol=2e-4)
        np.testing.assert_allclose(found["vol"], np.linalg.det(expected) - 1, atol=5e-4)

    def test_a_file_about_boxes_gives_another_strain(self, tmp_path, stretched, spam_python):
        labels, motions = stretched
        write_ddic_tsv(tmp_path / "a-ddic.tsv", motions, GRID, labels, about="box")
        found = np.array(run_in_spam(spam_python, STRAIN, tmp_path / "a-ddic.tsv")["F"])
        assert np.abs(found - (np.eye(3) + self.GRADIENT)[::-1, ::-1]).max() > 0.01

    def test_on_a_regular_grid(self, tmp_path, stretched, spam_python):
        """spam-passPhiField, then spam-regularStrain: spam 0.9.1 has no program for the strain of grains."""
        labels, motions = stretched
        write_ddic_tsv(tmp_path / "a-ddic.tsv", motions, GRID, labels)
        shape = [str(n) for n in GRID.shape]
        run_program(
            spam_python.parent / "spam-passPhiField", "-pf", tmp_path / "a-ddic.tsv", "-im1shape", *shape, "-ns", "6",
            "-F", "no", "-od", tmp_path, "-pre", "grid", "-np", "1",
        )  # fmt: skip
        strain = spam_python.parent / "spam-regularStrain"
        run_program(
            strain,
            "-pf",
            tmp_path / "grid-passed-ns6.tsv",
            "-comp",
            "e",
            "vol",
            "-rst",
            "0",
            "-od",
            tmp_path,
            "-np",
            "1",
        )
        table = pd.read_csv(tmp_path / "grid-passed-ns6-strain-Q8.tsv", sep="\t")
        inside = table[
            (table[["Zpos", "Ypos", "Xpos"]] > 12).all(axis=1) & (table[["Zpos", "Ypos", "Xpos"]] < 38).all(axis=1)
        ]
        # displacements interpolated between grains are smoothed, so the strain is too small, but has the right signs
        assert len(inside) > 20
        means = inside[["ezz", "eyy", "exx"]].mean().to_numpy()
        np.testing.assert_array_equal(np.sign(means), [1, -1, 1])
        np.testing.assert_allclose(means, [0.04, -0.05, 0.02], atol=0.03)
