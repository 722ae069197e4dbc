"""Every file of a results folder, read by pandas, h5py, tifffile and json alone, is as docs/files.md tells.

The page is parsed here, so that neither the files nor the page can change alone.  A file that the page lacks fails.
"""

from __future__ import annotations

import fnmatch
import json
import re
import runpy
import sys
from pathlib import Path
from xml.etree import ElementTree

import h5py
import numpy as np
import pandas as pd
import PIL.Image
import pyarrow.parquet
import pytest
import pyvista
import tifffile
import zarr
from typer.testing import CliRunner

from grainmotion.cli import app
from grainmotion.errors import InputError
from grainmotion.experiment.config import read_experiment
from grainmotion.io.appeared_csv import APPEARED_COLUMNS
from grainmotion.io.bodies_csv import BODY_COLUMNS
from grainmotion.io.catalogue import (
    APPEARED_DESCRIPTIONS,
    BODY_DESCRIPTIONS,
    PIECE_DESCRIPTIONS,
    SPAM_DESCRIPTIONS,
    kind_of,
)
from grainmotion.io.pieces_csv import PIECE_COLUMNS
from grainmotion.io.results import read_motions_h5, write_motions_h5
from grainmotion.io.results_folder import read_results
from grainmotion.io.spam_table import ADDED_COLUMNS, DDIC_COLUMNS
from grainmotion.workflow.run import run
from tiny_experiment import PANEL, SHIFTS, TOML, write_tiny

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "files.md"
ALL_OUTPUTS = """
[output]
exports = ["vtk", "spam", "tiff", "ome-zarr", "mechanics", "dem"]
series = ["h5", "csv", "parquet"]
rebuild = true
volumes = "hdf5"
[dem]
codes = ["yade", "lammps", "ls-dem"]
[calibrate]
geometry = ["shift_u"]
"""
REBUILT_BEFORE = {"one/rebuilt.h5", "two/rebuilt.h5"}
"""Files of a setting that was changed: they stay, but belong to no results."""
NOT_MADE_HERE = {
    "reconstruction.h5": "lost once it is segmented; the datasets of reference.h5",
    "beam_level.json": "tests/workflow/test_beam_level_stage.py",
    "checks*.json": "nothing was noticed; tests/io/test_findings_json.py",
    "radiographs.json": "nothing was noticed",
    "STATE/checks*.json": "nothing was noticed",
    "STATE/radiographs.json": "nothing was noticed",
    "watch.html": "tests/workflow/test_watch.py",
    "STATE/bodies.csv": "columns below",
    "STATE/appeared.csv": "columns below",
    "STATE/pieces.csv": "columns below",
}
"""Sections of the page on files that a run of three balls does not write, and why."""
HDF5_ROOT = {"content", "version", "frame", "settings"}


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Path:
    """The results of a small run with every output, and of a plan."""
    path = write_tiny(tmp_path_factory.mktemp("files"), TOML.replace("search = false", "search = false\nstrain = true"))
    path.write_text(path.read_text() + ALL_OUTPUTS)
    run(read_experiment(path))
    path.write_text(path.read_text().replace('volumes = "hdf5"', 'volumes = "ome-zarr"'))
    run(read_experiment(path))
    command = ["plan", str(path), "--quiet", "--views", "2", "--step-deg", "45"]
    result = CliRunner().invoke(app.app, command)
    assert result.exit_code == 0, result.output
    return path.parent / "results"


@pytest.fixture(scope="module")
def page() -> dict[str, dict[str, tuple[str, str]]]:
    """Rows of each section of the page: name of a column, dataset or key, to unit and meaning."""
    sections = re.split(r"^## `(.+)`$", PAGE.read_text(), flags=re.MULTILINE)[1:]
    rows = (re.findall(r"^\| `([^`]+)` \| (.*?) \| (.*?) \|$", text, flags=re.MULTILINE) for text in sections[1::2])
    return {name: {row[0]: (row[1], row[2]) for row in found} for name, found in zip(sections[::2], rows, strict=True)}


def files_of(results: Path) -> list[str]:
    """Paths of all files; an OME-Zarr folder, and that for DEM codes but its tables, count as one."""
    paths = (p.relative_to(results).as_posix() for p in results.rglob("*") if p.is_file())
    return sorted({re.sub(r"(\.ome\.zarr|^dem)/(?!\w+\.csv$).*", r"\1", path) for path in paths})


def section_of(page, place: str):
    """The section on a file; its name has STATE for the folder of a state."""
    for state in SHIFTS:
        place = re.sub(rf"^{state}/", "STATE/", place)
    found = [rows for name, rows in page.items() if fnmatch.fnmatchcase(place, name)]
    assert len(found) == 1, f"docs/files.md has {len(found)} sections on {place}: add it to grainmotion.io.catalogue"
    return found[0]


def test_the_page_is_up_to_date(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["write_files_page.py", "--check"])
    runpy.run_path(str(ROOT / "docs" / "write_files_page.py"), run_name="__main__")


def test_every_file_is_on_the_page(results, page):
    places = files_of(results)
    assert len(places) > 25
    for place in places:
        section_of(page, place)
        assert kind_of(place) is not None


def test_tables_have_the_columns_of_the_page(results, page):
    tables = [place for place in files_of(results) if place.endswith(".csv")]
    assert {"one/motions.csv", "one/strains.csv", "one/contacts.csv", "series.csv", "plan/plan.csv"} <= set(tables)
    for place in tables:
        table = pd.read_csv(results / place)
        assert list(table.columns) == list(section_of(page, place)), place
    for place in ("one/grains-ddic.tsv", "two/grains-ddic.tsv"):
        assert list(pd.read_csv(results / place, sep="\t").columns) == list(section_of(page, place))
    assert list(pd.read_parquet(results / "series.parquet").columns) == list(page["series.parquet"])


def test_tables_without_strains_lack_the_last_columns_only(page, tmp_path):
    path = write_tiny(tmp_path)
    run(read_experiment(path), until="track")
    table = pd.read_csv(tmp_path / "results" / "one" / "motions.csv")
    assert list(table.columns) == list(page["STATE/motions.csv"])[:-12]


def test_data_package_describes_the_tables(results, page):
    package = json.loads((results / "datapackage.json").read_text())
    assert package["grainmotion"]
    assert "sample frame" in package["frame"]
    assert package["settings"]["track"]["strain"] is True
    assert package["settings"]["states"][0]["name"] == "one"
    told = {resource["path"]: resource for resource in package["resources"]}
    assert len({resource["name"] for resource in package["resources"]}) == len(package["resources"])
    assert "dem/poses.csv" in told
    assert set(told) == set(files_of(results)) - {"datapackage.json"} - REBUILT_BEFORE
    for place, resource in told.items():
        assert resource["title"]
        if place.endswith((".csv", ".tsv", ".parquet")):
            fields = {f["name"]: (f["unit"], f["description"]) for f in resource["schema"]["fields"]}
            assert fields == section_of(page, place)


def test_hdf5_files_tell_units_and_meanings(results, page):
    for place in ("reference.h5", "one/motions.h5"):
        told = section_of(page, place)
        with h5py.File(results / place) as file:
            assert set(file.attrs) == HDF5_ROOT
            assert json.loads(file.attrs["settings"])
            items: dict[str, h5py.Group | h5py.Dataset] = {"": file}
            file.visititems(items.__setitem__)
            for path, item in items.items():
                if isinstance(item, h5py.Dataset):
                    assert (item.attrs["unit"], item.attrs["meaning"]) == told[path], path
                for name in set(item.attrs) - {"unit", "units", "meaning"}:
                    assert f"{path}.{name}" in told, f"{place}: {path}.{name}"


def all_files(results: Path) -> list[str]:
    """Paths of all files, those in folders for DEM codes as well; an OME-Zarr folder counts as one."""
    paths = (p.relative_to(results).as_posix() for p in results.rglob("*") if p.is_file())
    return sorted({re.sub(r"(\.ome\.zarr)/.*", r"\1", path) for path in paths})


def test_every_section_is_on_files_that_were_read_and_every_file_has_one(results, page):
    """Both ways: no file that the page lacks, also within dem, and no section without a file but those named."""
    made = set()
    for place in all_files(results):
        general = re.sub(rf"^({'|'.join(SHIFTS)})/", "STATE/", place)
        found = [name for name in page if fnmatch.fnmatchcase(general, name)]
        assert len(found) == 1, f"docs/files.md has {len(found)} sections on {place}"
        made |= set(found)
    assert made | {"dem"} | set(NOT_MADE_HERE) == set(page)
    assert not made & set(NOT_MADE_HERE)


def told_by(path: Path, package: dict) -> str:
    """All that a file tells of itself in words, read by common libraries."""
    suffix = path.suffix
    if suffix == ".h5":
        with h5py.File(path) as file:
            items: list[h5py.Group | h5py.Dataset] = [file]
            file.visititems(lambda _, item: items.append(item))
            return " ".join(f"{k}={v}" for item in items for k, v in item.attrs.items())
    if suffix in (".json", ".txt", ".log", ".html", ".py"):
        return path.read_text()
    if suffix in (".csv", ".tsv"):  # plain tables; the data package beside them tells the rest
        place = path.relative_to(package["folder"]).as_posix()
        schema = next(r["schema"] for r in package["resources"] if r["path"] == place)
        return json.dumps([schema, package["grainmotion"], package["frame"]])
    if suffix == ".parquet":
        return str(pyarrow.parquet.read_schema(path).metadata)
    if suffix == ".tif":
        with tifffile.TiffFile(path) as file:
            return str(file.imagej_metadata or file.pages[0].description)
    if suffix == ".zarr":
        group = zarr.open_group(str(path), mode="r")
        return json.dumps([dict(group.attrs), dict(group["labels/grains"].attrs)])
    if suffix in (".vti", ".vtp"):
        data = pyvista.read(path).field_data
        return str({name: list(data[name]) for name in data})
    if suffix == ".npz":
        with np.load(path) as file:
            return str(file["made_by"])
    if suffix == ".stl":
        return path.read_bytes()[:80].decode()
    with PIL.Image.open(path) as image:
        return str(image.info)


def test_every_file_tells_program_and_version(results):
    """Without the package.  A .pvd names other files; the README tells of the script and of the numbers for LS-DEM."""
    package = {**json.loads((results / "datapackage.json").read_text()), "folder": results}
    program, version = "grainmotion", package["grainmotion"]
    names = [n for n in all_files(results) if not n.endswith((".pvd", ".dat", ".py"))]
    assert len({Path(name).suffix for name in names}) >= 14
    for name in names:
        text = told_by(results / name, package)
        assert version in text, name
        assert program in text or name.endswith(("motions.h5", "reference.h5", ".csv", ".tsv", ".parquet")), name
    readme = told_by(results / "dem" / "README.txt", package)
    for name in ("morphology_", "labels_", "positions_", "rotations_", "yade_level_sets.py"):
        assert name in readme


def test_every_file_of_lengths_tells_their_unit_and_frame(results):
    package = {**json.loads((results / "datapackage.json").read_text()), "folder": results}
    texts = {"stages.json", "run.log", "report.html", "dem/yade_level_sets.py", "plan/plan.png"}
    texts |= {n for n in all_files(results) if n.endswith((".pvd", ".dat", ".npz"))}
    for name in set(all_files(results)) - texts:
        text = told_by(results / name, package)
        assert re.search(r"\bmm\b|line integral|voxel", text), name
        assert re.search(r"frame|z up|\[z, y, x\]", text), name


def test_collections_name_files_that_are_there(results):
    for name in ("grains.pvd", "surfaces.pvd"):
        sets = ElementTree.parse(results / name).getroot().findall(".//DataSet")
        assert len(sets) == 1 + len(SHIFTS)
        assert all((results / s.get("file")).is_file() for s in sets)


def test_series_tells_units_and_meanings(results):
    with h5py.File(results / "series.h5") as file:
        assert {"version", "frame", "settings", "content"} <= set(file.attrs)
        items: dict[str, h5py.Group | h5py.Dataset] = {}
        file.visititems(items.__setitem__)
        assert all({"unit", "meaning"} <= set(i.attrs) for i in items.values() if isinstance(i, h5py.Dataset))


def test_json_files_have_the_keys_of_the_page(results, page):
    found = [p for p in files_of(results) if p.endswith(".json") and p != "datapackage.json"]
    assert {"stages.json", "one/mechanics.json", "reference_mechanics.json"} <= set(found)
    for place in found:
        assert set(json.loads((results / place).read_text())) == set(section_of(page, place)), place


def test_residuals_tell_what_they_are(results):
    with tifffile.TiffFile(results / "one" / "residuals.tif") as file:
        told = json.loads(file.pages[0].description)
        assert file.asarray().shape == (3, *PANEL)
    assert {"grainmotion", "frame", "content", "unit"} <= set(told)
    assert "line integral" in told["unit"]


def test_numbers_of_a_table_and_of_hdf5_agree(results):
    """Read without the package: mm in both; degrees in the table, radians in the other."""
    table = pd.read_csv(results / "one" / "motions.csv")
    with h5py.File(results / "one" / "motions.h5") as file:
        np.testing.assert_allclose(table[["ux", "uy", "uz"]], file["translations"][()], rtol=1e-9)
        np.testing.assert_allclose(np.deg2rad(table[["wx", "wy", "wz"]]), file["rotations"][()], rtol=1e-9)
        sd = np.sqrt(np.diagonal(file["covariances"][()], axis1=1, axis2=2))
        np.testing.assert_allclose(table[["sd_ux", "sd_uy", "sd_uz"]], sd[:, :3], rtol=1e-9)
        assert file["rotations"].attrs["unit"] == "rad"


def test_tables_of_the_page_are_those_that_are_written():
    """Files that this run does not have: bodies, new grains and pieces."""
    assert tuple(BODY_DESCRIPTIONS) == BODY_COLUMNS
    assert tuple(APPEARED_DESCRIPTIONS) == APPEARED_COLUMNS
    assert tuple(PIECE_DESCRIPTIONS) == PIECE_COLUMNS
    assert tuple(SPAM_DESCRIPTIONS) == (*DDIC_COLUMNS, *ADDED_COLUMNS)


class TestReadResults:
    def test_everything_is_read_back(self, results):
        found = read_results(results)
        assert list(found.motions) == list(SHIFTS)
        assert found.volume.shape == found.labels.shape
        np.testing.assert_array_equal(found.grains.labels, found.motions["one"].labels)
        np.testing.assert_allclose(found.grains.centers, found.motions["one"].centers, atol=1e-6)
        table = found.motions["one"].to_dataframe()
        assert table.attrs["units"]["wx"] == "deg"

    def test_a_folder_without_results_is_named(self, tmp_path):
        with pytest.raises(InputError, match=r"it holds no reference\.h5"):
            read_results(tmp_path)
        with pytest.raises(InputError, match="no such folder"):
            read_results(tmp_path / "none")
        (tmp_path / "reference.h5").write_bytes(b"no HDF5")
        assert read_results(tmp_path).motions == {}
        with pytest.raises(InputError, match=r"reference\.h5"):
            _ = read_results(tmp_path).volume

    def test_motions_without_settings_are_read(self, results, tmp_path):
        motions = read_motions_h5(results / "one" / "motions.h5")
        write_motions_h5(tmp_path / "motions.h5", motions)
        assert len(read_motions_h5(tmp_path / "motions.h5")) == len(motions)
