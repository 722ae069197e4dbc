"""A user's day: a scanner's folders, `init`, `run`, and the results in other programs' files, against the truth.

The simulated counts are written as a Nikon scanner leaves them: divided by the flats, seen from behind, row 0 at the
top, angles growing as the stage turns clockwise from above.
"""

import numpy as np
import pandas as pd
import pytest
import tifffile
from typer.testing import CliRunner

from grainmotion.analysis.validation import compare
from grainmotion.cli.app import app
from grainmotion.io.motions_csv import read_motions
from grainmotion.simulate.scenarios import small

WHITE = 60000
VOXEL = 0.125  # mm
XTEKCT = """[XTekCT]
Name={name}
InputSeparator=_
InputFolderName=
SrcToObject={to_axis}
SrcToDetector={to_panel}
DetectorPixelsX={columns}
DetectorPixelSizeX={pixel}
DetectorOffsetX=0.0
DetectorPixelsY={rows}
DetectorPixelSizeY={pixel}
DetectorOffsetY=0.0
Projections={count}
InitialAngle={first}
AngularStep={step}
WhiteLevel={white}
ObjectOffsetX=0.0
ObjectTilt=0.0
ObjectRoll=0.0
[Xrays]
XraykV=90
""".replace("\n", "\r\n")
STATE_ANGLES = (0.0, 45.0, 90.0, 135.0)
NAMES = ("load 1", "load 2")


def write_scan(folder, geometry, lines, angles):
    """One folder of the scanner."""
    folder.mkdir()
    for k, image in enumerate(lines, start=1):
        counts = np.round(WHITE * np.exp(-image[::-1, ::-1])).astype(np.uint16)  # rows from the top, seen from behind
        tifffile.imwrite(folder / f"{folder.name}_{k:04d}.tif", counts)
    to_axis = float(np.linalg.norm(geometry.source[0]))
    text = XTEKCT.format(
        name=folder.name, to_axis=to_axis, to_panel=float(np.linalg.norm(geometry.rays[0])),
        rows=geometry.shape[0], columns=geometry.shape[1], pixel=float(np.linalg.norm(geometry.u[0])),
        count=len(angles), first=angles[0], step=angles[1] - angles[0], white=WHITE,
    )  # fmt: skip
    (folder / f"{folder.name}.xtekct").write_bytes(text.encode("cp1252"))


@pytest.fixture(scope="module")
def day(tmp_path_factory):
    """The folder after the day, and the true motions."""
    folder = tmp_path_factory.mktemp("day")
    case = small(seed=3)
    reference = case.reference()
    write_scan(folder / "initial", reference.geometry, reference.line_integrals, reference.geometry.azimuths_deg)
    truth = {"load 1": case.motions["shift"], "load 2": case.motions["random"]}
    for number, name in enumerate(NAMES, start=1):
        scan = case.state(truth[name], STATE_ANGLES, number)
        write_scan(folder / name, scan.geometry, scan.line_integrals, np.array(STATE_ANGLES))
    run = CliRunner().invoke(app, ["init", str(folder)])
    assert run.exit_code == 0, run.output
    path = folder / "experiment.toml"
    path.write_text(path.read_text() + '\n[output]\nexports = ["vtk", "spam"]\n')
    run = CliRunner().invoke(app, ["run", str(path), "--quiet"])
    assert run.exit_code == 0, run.output
    return folder, truth, run.output


def test_the_motions_are_those_of_the_sample_on_the_stage(day):
    folder, truth, _ = day
    for name in NAMES:
        found = compare(read_motions(folder / "results" / name / "motions.csv"), truth[name], VOXEL)
        assert found.failures == 0
        assert found.translation_rms_voxels < 0.02
        assert found.rotation_rms_deg < 0.3


def test_the_results_are_there_for_other_programs(day):
    folder, _, _ = day
    for name in NAMES:
        table = pd.read_csv(folder / "results" / name / "grains-ddic.tsv", sep="\t")
        assert (table["returnStatus"][1:] == 2).all()
        assert (folder / "results" / name / "grains.vtp").exists()
    assert (folder / "results" / "series.csv").exists()
