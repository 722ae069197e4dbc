"""The picture of an inspection: which way is up, and which way the sample turns, against a simulated grain."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.text import Annotation

from grainmotion.experiment.inspection import FirstViews
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.report.inspection_figure import DrawnScan, inspection_figure
from grainmotion.simulate import Particle, Sample, line_integrals
from grainmotion.simulate.shapes import Ellipsoid

GRID = Volume.zeros((40, 40, 40), 0.25)
ANGLES = np.arange(0, 180, 5.0)


def geometry(angles: np.ndarray, beam: str, first_row: str = "bottom") -> Geometry:
    panel = DetectorAlignment(first_row=first_row)  # type: ignore[arg-type]
    if beam == "parallel":
        return Geometry.parallel(angles, (40, 48), 0.25, panel=panel)
    return Geometry.cone(angles, (40, 48), 0.75, source_to_axis=60.0, source_to_detector=180.0, panel=panel)


def drawn(angles: np.ndarray = ANGLES, beam: str = "cone", first_row: str = "bottom") -> DrawnScan:
    """A small grain high up in front of the axis, on the side of the source at 0 degrees."""
    return DrawnScan(FirstViews.of("scan", simulated(angles, beam, first_row)), GRID)


def simulated(angles: np.ndarray, beam: str, first_row: str = "bottom") -> Scan:
    """All views of the grain."""
    views = geometry(angles, beam, first_row)
    grain = Particle(Ellipsoid(np.array([0.0, -3.0, 2.0]), np.full(3, 0.6), np.eye(3)), 0.5)
    return Scan(line_integrals(Sample((grain,)), views), views)


def centroids(scan: Scan) -> np.ndarray:
    """Row and column of the grain in each radiograph."""
    images = scan.line_integrals
    index = np.indices(images.shape[1:])
    return np.einsum("vij,kij->vk", images, index) / images.sum(axis=(1, 2))[:, None]


@pytest.mark.parametrize("beam", ["cone", "parallel"])
@pytest.mark.parametrize("sign", [1, -1])
def test_the_followed_point_moves_like_a_grain_in_front(beam: str, sign: int):
    d = drawn(sign * ANGLES, beam)
    measured = centroids(d.scan)[:, 1] - 23.5
    assert measured == pytest.approx(d.points[:, 0, 1] - 23.5, abs=0.35)  # both at 3 mm from the axis
    assert d.moves_right is bool(measured[1] > 0)
    assert ("counter-clockwise" in d.sentence) is d.moves_right


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_images_from_behind_show_the_other_sense_of_rotation(beam: str):
    d = drawn(ANGLES, beam)
    flipped = geometry(ANGLES, beam).vectors * np.repeat([1, 1, -1, 1], 3)
    views = Geometry(flipped, (40, 48), d.scan.geometry.beam)
    scan = Scan(simulated(ANGLES, beam).line_integrals[:, :, ::-1], views)
    behind = DrawnScan(FirstViews.of("scan", scan), GRID)
    assert behind.moves_right is not d.moves_right
    assert behind.sentence.split("turns ")[1] == d.sentence.split("turns ")[1]
    assert "from behind" in behind.sentence


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("behind", [False, True])
def test_the_set_up_is_drawn_as_it_stands_whichever_side_the_images_show(sign: int, behind: bool):
    """From above, with the source in front, the front of a stage that turns counter-clockwise moves to the right."""
    views = geometry(sign * ANGLES, "cone")
    if behind:
        views = Geometry(views.vectors * np.repeat([1, 1, -1, 1], 3), views.shape, "cone")
    scan = Scan(np.zeros((len(ANGLES), 40, 48)), views)
    d = DrawnScan(FirstViews.of("scan", scan), GRID)
    figure = inspection_figure([d.first], GRID)
    setup = figure.axes[0]
    (arrow,) = [text for text in setup.texts if isinstance(text, Annotation) and text.arrow_patch is not None]
    assert (arrow.xy[0] > 0) is ("counter-clockwise" in d.sentence)
    places = {text.get_text(): text.get_position()[0] for text in setup.texts}
    assert (places["column 0"] > places["47"]) is behind
    assert [axes.get_title() for axes in figure.axes[1:]][1] == f"view 3, {sign * 15:.1f}°"


@pytest.mark.parametrize("first_row", ["bottom", "top"])
def test_z_is_up(first_row: str):
    d = drawn(first_row=first_row)
    row = centroids(d.scan)[0, 0]
    assert bool(row > 19.5) is (first_row == "bottom")  # the grain is high up
    axes = inspection_figure([d.first], GRID).axes[1]
    bottom, top = axes.get_ylim()
    assert abs(row - top) < abs(row - bottom)
    assert axes.get_images()[0].origin == ("lower" if d.upright else "upper")
    assert ("row 0 is the lowest" in d.sentence) is (first_row == "bottom")


def test_first_views_are_near_the_first_angle():
    assert drawn().first.views == (0, 3, 8, 18)
    assert drawn(ANGLES[:4]).first.views == (0, 1, 2, 3)


def test_a_single_view_has_no_sense_of_rotation():
    d = drawn(np.array([10.0]))
    assert d.moves_right is None
    assert d.sentence == "scan: row 0 is the lowest row"


def test_several_scans_make_one_png():
    figure = inspection_figure([drawn().first, drawn(ANGLES[:2]).first], GRID)
    stream = io.BytesIO()
    figure.savefig(stream, format="png")
    assert stream.getvalue()[1:4] == b"PNG"
    titles = [axes.get_title() for axes in figure.axes if axes.get_title()]
    assert titles[1:3] == ["view 0, 0.0°", "view 3, 15.0°"]
