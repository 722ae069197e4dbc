"""North Star Imaging ``.nsipro``: what the project and the folders beside it tell about a scan.

The vectors of ``Result`` are in one right-handed frame, mm: ``source``; ``reference``, the pixel in the first row and
column; ``normal``, from the source to the panel; ``horizontal``, along rows from the first to the last column as the
source sees it; rows follow ``normal x horizontal``, downwards.  The rotation axis goes through the origin along
``axis``.  ``clockwise`` is the stage seen from above.  ``Correction`` tells how the images have to be flipped and then
turned, clockwise, for this.  So reads mbirjax (``preprocess/nsi.py``), whose authors use it on scans of such a scanner.
"""

from __future__ import annotations

import re
from pathlib import Path, PureWindowsPath

import numpy as np

from grainmotion._typing import Float, Index
from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.io.scanners.image_series import ImageSeries, tiff_files, views_shown
from grainmotion.io.scanners.nsi_project import NsiProject, read_nsi_project
from grainmotion.io.scanners.rigid_setup import RigidSetup, circle_numbers
from grainmotion.model.finding import Finding, Level

MAX_REPORT_DIFFERENCE = 20.0
"""Pixels by which the geometry report may place the panel elsewhere than the project: it corrects by a few."""
MAX_ANGLE_DIFFERENCE = 0.5
"""Steps by which a recorded angle may differ from equal steps."""


def read_nsi_scan(path: Path) -> ScannerFile:
    """What a ``.nsipro`` file tells about its scan."""
    project = read_nsi_project(path)
    pitch = project.numbers("Object Radiograph", "pitch", 2)
    shape = project.whole("Detector", "height pixels"), project.whole("Detector", "width pixels")
    series = _radiographs(project)
    views, findings = views_shown(path, series, project.whole("Object Radiograph", "number"))
    if series.shape is not None and series.shape != shape:
        fact = f"its Detector has {shape} pixels, but the radiographs have {series.shape}"
        raise InputError(str(path), fact, "give the radiographs as they were taken, neither binned nor cropped")
    if not (pitch.min() > 0 and np.ptp(pitch) < 1e-4 * pitch[0]):
        raise InputError(str(path), f"pixels of {pitch[0]} x {pitch[1]} (pitch) are not square", "give views as a file")
    setup, found = _setup(project, shape, float(pitch[0]))
    numbers, mirrored = circle_numbers(str(path), setup)
    sense = 1.0 if project.flag("Processed", "clockwise") else -1.0
    angles, told = _angles(project, series, views)
    beam_images = [sorted(path.parent.glob(f"*/{name}")) for name in ("gain0.tif", "offset.tif")]
    flats, darks = ((str(files[0].absolute()),) if len(files) == 1 else () for files in beam_images)
    return ScannerFile(
        path,
        "NSI .nsipro",
        CircleNumbers(beam="cone", pixel_size=float(pitch[0]), angles_deg=sense * angles, **numbers),
        radiographs=series.pattern,
        flats=flats,
        darks=darks,
        mirrored=mirrored,
        facts=_facts(project),
        findings=(*findings, *found, *told),
    )


def _setup(project: NsiProject, shape: tuple[int, int], pitch: float) -> tuple[RigidSetup, tuple[Finding, ...]]:
    """Where source, axis and panel stand, with the directions of columns and rows of the files."""
    source, axis, normal, u = (project.numbers("Result", n, 3) for n in ("source", "axis", "normal", "horizontal"))
    corner, findings = _first_pixel(project, pitch)
    u, v = (d / max(np.linalg.norm(d), np.finfo(float).tiny) for d in (u, np.cross(normal, u)))
    if not (u.any() and v.any() and axis.any()):
        fact = "axis, normal or horizontal of the section <Result> are zero or parallel"
        raise InputError(str(project.path), fact, "repeat the geometry calibration, or give the views as a file")
    if (corner - source) @ normal <= 0:
        fact = "<normal> of the section <Result> points from the panel to the source, not along the beam"
        raise InputError(str(project.path), fact, "repeat the geometry calibration, or give the views as a file")
    rotate = float(project.numbers("Correction", "rotate", 1)[0])
    if rotate % 90:
        fact = f"<rotate> of the section <Correction> is {rotate:g} degrees, no quarter turns"
        raise InputError(str(project.path), fact, "turn the radiographs upright, or give the views as a file")
    turns = round(rotate / 90) % 4
    rows, columns = shape if turns % 2 == 0 else shape[::-1]  # of the images as Correction leaves them
    center = corner + pitch * ((columns - 1) / 2 * u + (rows - 1) / 2 * v)
    up = axis if axis @ v < 0 else -axis
    for _ in range(turns):  # those of the files: the turns undone, then the flips before them
        u, v = v, -u
    u = -u if project.flag("Correction", "flipH") else u
    v = -v if project.flag("Correction", "flipV") else v
    units = project.text("Setup", "units").strip("[] ")
    if units not in ("", "mm"):
        fact = f"its units are '{units}', but distances and pitch were taken as mm, in which such files hold them"
        findings += (Finding(Level.WARNING, "sizes", project.path.name, fact, remedy="compare pixel_size"),)
    return RigidSetup(source, center, u, v, up), findings


def _first_pixel(project: NsiProject, pitch: float) -> tuple[Float, tuple[Finding, ...]]:
    """The pixel in the first row and column: of the geometry report if there is one, which mbirjax found better."""
    reference = project.numbers("Result", "reference", 3)
    for report in sorted(project.path.parent.glob("Geometry*.rtf")):
        text = re.sub(r"\\[a-z]+-?\d* ?|[{}]", " ", report.read_text("latin-1"))
        match = re.search(r"Image center[^(]*\(\s*([-+.\d]+)\s*,\s*([-+.\d]+)\s*\)\s*\[mm\]", text)
        if match is None:
            continue
        told = np.array([float(match[1]), float(match[2]), reference[2]])
        pixels = float(np.abs(told - reference).max()) / pitch
        used = pixels <= MAX_REPORT_DIFFERENCE
        fact = f"{report.name} places the panel {pixels:.3g} pixels from where the project does, and was "
        fact += "used" if used else "not used"
        level = Level.NOTE if used else Level.WARNING
        remedy = "" if used else f"move {report.name} away if it is of another scan; else check detector_offset"
        return (told if used else reference), (Finding(level, "sizes", project.path.name, fact, remedy=remedy),)
    return reference, ()


def _angles(project: NsiProject, series: ImageSeries, views: Index) -> tuple[Float, tuple[Finding, ...]]:
    """Angles in the sense of the stage, degrees: those recorded beside the radiographs, else equal steps."""
    step = float(project.numbers("Object Radiograph", "angleStep", 1)[0])
    angles: Float = step * views.astype(float)
    record = series.files[0].parent / "positions.txt" if series.files else None
    if record is None or not record.is_file():
        return angles, ()
    lines = [line.split(None, 1) for line in record.read_text("latin-1").split("\n") if not line.startswith("#")]
    named = {PureWindowsPath(line[1].strip()).name: line[0] for line in lines if len(line) == 2}
    try:
        recorded = np.array([float(named[file.name]) for file in series.files])
    except (KeyError, ValueError):
        recorded = np.full(len(angles), np.nan)
    if np.abs(recorded - recorded[0] - angles + angles[0]).max() <= MAX_ANGLE_DIFFERENCE * abs(step):
        return recorded, ()
    fact = f"angles of {record.name} are missing or no equal steps of {step:.5g}, and were not used"
    return angles, (Finding(Level.WARNING, "angle-table", project.path.name, fact, remedy="give angles_deg"),)


def _radiographs(project: NsiProject) -> ImageSeries:
    """The images that the project names, else those of the only folder of radiographs."""
    named, folder = PureWindowsPath(project.text("Object Radiograph", "file")), project.path.parent
    for k in range(len(named.parts)):
        place = folder.joinpath(*named.parts[k:-1])
        if place.is_dir() and (series := tiff_files(place, named.name)).files:
            return series
    found = [p for p in folder.glob("Radiographs*") if p.is_dir()]
    return tiff_files(found[0], without="zero_pos") if len(found) == 1 else ImageSeries()


def _facts(project: NsiProject) -> tuple[tuple[str, str], ...]:
    """Project, voltage and so on, as text."""
    labels = {"Project Name": "Project", "kV": "Voltage, kV", "uA": "Current, uA", "Date": "Date", "units": "Units"}
    found = {labels[name]: value for (_, name), value in project.values.items() if name in labels and value}
    return tuple(found.items())
