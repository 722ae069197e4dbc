"""A laboratory's folder of each format: `grainmotion init` writes an experiment file that can be run at once."""

import numpy as np
import pytest
import test_bruker_scan as bruker
import test_nikon_scan as nikon
import test_nsi as nsi
import test_phoenix_scan as phoenix
import test_rx_solutions as rx
import test_zeiss as zeiss
from typer.testing import CliRunner

from grainmotion.cli.app import app
from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from lab_scanner import Lab
from nxtomo_library import write_with_nxtomo
from scanner_folder import MAX_MISFIT, changed, misfit, write_images

COUNT, STEP = 12, 30.0
ANGLES = STEP * np.arange(COUNT)


def nikon_folder(folder):
    keys = {"Projections": COUNT, "InitialAngle": 0, "AngularStep": STEP}
    names = [f"Beads [1]_{n:04d}.tif" for n in range(1, COUNT + 1)]
    nikon.folder_of(folder, changed(nikon.FILE, **keys), nikon.images(ANGLES), names)


def bruker_folder(folder):
    text = changed(bruker.FILE, **{"Number Of Files": COUNT, "Rotation Step (deg)": STEP})
    bruker.folder_of(folder, text, bruker.images(ANGLES), [f"beads~00{n:08d}.tif" for n in range(COUNT)])


def phoenix_folder(folder):
    names = [f"beads_{n:04d}.tif" for n in range(1, COUNT + 1)]
    phoenix.folder_of(folder, changed(phoenix.FILE, NumberImages=COUNT), phoenix.images(ANGLES), names)


def rx_folder(folder, *, csv):
    rx.scan_folder(folder / "rx", angles=-ANGLES, csv=csv, lab=rx.LAB if csv else Lab())


def nsi_folder(folder):
    given = {"angleStep": STEP, "number": COUNT}
    nsi.scan_folder(folder / "nsi", images=nsi.LAB.images(-ANGLES), **given)


FOLDERS = {  # how a folder is written, and what a user changes in the draft
    "nikon": (nikon_folder, ()),
    "bruker": (bruker_folder, ()),
    "phoenix": (phoenix_folder, ()),
    "rx": (lambda folder: rx_folder(folder, csv=True), (("# white_level", "white_level"),)),
    "rx without table": (
        lambda folder: rx_folder(folder, csv=False),
        (("# white_level", "white_level"), ("# pixel_size = 0.1", "pixel_size = 0.4")),
    ),
    "nsi": (nsi_folder, ()),
    "zeiss": (lambda folder: zeiss.scan_file(folder / "scan.txrm", angles=ANGLES), (("# geometry", "geometry"),)),
    "nxtomo": (lambda folder: write_with_nxtomo(folder / "scan.nxs", Lab(), ANGLES), ()),
}


@pytest.mark.parametrize("name", FOLDERS)
def test_the_draft_of_a_folder_can_be_run(tmp_path, name):
    write, changes = FOLDERS[name]
    (tmp_path / "scan").mkdir()
    write(tmp_path / "scan")
    for step, turn in (("step-01", 5), ("step-02", 10)):
        (tmp_path / step).mkdir()
        shape = (50, 64) if name in ("rx", "nsi") else (56, 64)
        lines = Lab(shape=shape).images(np.array([0, 45, 90, 135]) + turn)
        write_images(tmp_path / step, [f"r_{angle:03d}deg.tif" for angle in (0, 45, 90, 135)], lines, 40_000)
    result = CliRunner().invoke(app, ["init", str(tmp_path)])
    assert result.exit_code == 0, result.output
    path = tmp_path / "experiment.toml"
    assert ("to fill in" in result.output) is bool(changes), result.output
    text = path.read_text()
    for draft, filled in changes:
        assert draft in text, text
        text = text.replace(draft, filled)
    path.write_text(text)
    inputs = find_inputs(read_experiment(path))
    assert [len(state.geometry) for state in inputs.states] == [4, 4]
    assert misfit(inputs.reference) < MAX_MISFIT
