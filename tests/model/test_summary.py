"""What records show of themselves: short, escaped, quick whatever their size, without their arrays."""

import re
from dataclasses import dataclass, replace

import numpy as np
import pytest

import few_grains
from grainmotion.model.geometry import Geometry
from grainmotion.model.motions import Motions
from grainmotion.model.scan import Scan
from grainmotion.model.state_fit import StateFit
from grainmotion.model.summary import Summarised, Summary, counted_rows, names_text, value_text
from grainmotion.model.volume import Volume

MARKUP = "<script>alert(1)</script>"


@dataclass(frozen=True, repr=False)
class Record(Summarised):
    """A record without a summary of its own."""

    name: str
    image: np.ndarray
    numbers: tuple[float, ...]


def many_motions(n: int) -> Motions:
    motions = Motions.identity(np.arange(1, n + 1), np.random.default_rng(0).normal(size=(n, 3)))
    return replace(motions, translations=motions.centers, statuses=np.full(n, "converged", dtype="<U20"))


def test_text_of_users_is_escaped_in_notebooks():
    summary = Summary(MARKUP, MARKUP, ((MARKUP, MARKUP),), counts={"converged": 2})
    assert "<script>" not in summary.html
    assert "&lt;script&gt;" in summary.html
    fit = StateFit(notes=(MARKUP,), costs=((MARKUP, 0.1), (MARKUP, 0.05)))
    assert "<script>" not in fit._repr_html_()


def test_records_list_their_fields_and_no_array():
    shown = repr(Record("a", np.zeros((300, 400)), (1.0, 2.5)))
    assert shown == "<Record: name a, image 300 × 400 float64, numbers 1, 2.5>"
    assert "300 × 400 float64" in Record("a", np.zeros((300, 400)), ())._repr_html_()


def test_long_texts_and_lists_are_cut():
    assert len(value_text("x" * 1000)) <= 160
    assert value_text(tuple(range(50))) == "50 items"
    assert names_text([f"step-{k}" for k in range(20)]).endswith("… 13 more …, step-19")
    rows = counted_rows({f"s{k}": {"converged": 3} for k in range(30)})
    assert len(rows) == 8
    assert rows[-1] == ("s29", "3 converged")
    assert rows[-2] == ("…", "23 more")


def test_motions_count_their_statuses():
    statuses = np.array(["converged", "absent", "converged"], dtype="<U20")
    motions = replace(many_motions(3), statuses=statuses)
    assert "2 converged, 1 absent" in repr(motions)
    assert motions._repr_html_().count("<i style") == 2
    assert motions.status_counts == {"converged": 2, "absent": 1}


def test_no_large_array_is_gone_through():
    volume, scan = Volume.zeros((2, 2, 2), 0.1), Scan(np.zeros((1, 2, 2)), Geometry.parallel([0], (2, 2), 0.1))
    endless = np.broadcast_to(np.float32(1), (4000, 4000, 4000))  # 256 GB if any array of its size were made
    object.__setattr__(volume, "array", endless)
    object.__setattr__(scan, "line_integrals", endless)
    assert "4000 × 4000 × 4000" in repr(volume)
    assert len(volume._repr_html_()) + len(scan._repr_html_()) < 10_000


@pytest.mark.parametrize("record", [Geometry.parallel(np.arange(0, 360, 0.05), (9, 9), 0.1), many_motions(5000)])
def test_pictures_of_many_views_and_grains_stay_small(record):
    assert len(repr(record)) < 200
    assert len(record._repr_html_()) < 30_000


@pytest.mark.parametrize("upright", [True, False])
def test_pictures_show_radiographs_with_z_upwards(upright):
    import base64
    import io

    from PIL import Image

    from grainmotion.model.detector_alignment import DetectorAlignment

    panel = DetectorAlignment(first_row="bottom" if upright else "top")
    images = np.zeros((1, 20, 20), np.float32)
    images[0, 0] = 1  # row 0
    shown = Scan(images, Geometry.parallel([0], (20, 20), 0.1, panel=panel))._repr_html_()
    data = re.search(r"base64,([^\"]+)", shown)
    assert data is not None
    pixels = np.asarray(Image.open(io.BytesIO(base64.b64decode(data.group(1)))))
    assert pixels[-1 if upright else 0].min() == 255
    assert pixels[0 if upright else -1].max() == 0


def test_grains_and_their_set_tell_labels_and_voxels():
    grains = few_grains.grain_set()
    assert repr(grains) == "<GrainSet of 5 grains: voxel 0.1 mm>"
    assert "<td>1, 2, 3, 4, 5</td>" in grains._repr_html_()
    assert grains._repr_html_().count("<circle") == 5
    assert repr(grains.grains[0]).startswith("<Grain 1: centre (")


def test_nothing_known_is_shown_without_complaint():
    nothing = replace(Motions.identity(np.array([1]), np.zeros((1, 3))), translations=np.full((1, 3), np.nan))
    assert "not-fitted" in nothing._repr_html_()
    assert "<svg" in nothing._repr_html_()


def test_public_records_with_arrays_show_a_summary():
    import dataclasses
    import inspect

    import grainmotion as gm

    bare = []
    for module in (gm, gm.simulate):
        for record in (getattr(module, name) for name in module.__all__):
            if inspect.isclass(record) and dataclasses.is_dataclass(record) and not issubclass(record, Summarised):
                types = " ".join(str(f.type) for f in dataclasses.fields(record))
                bare += (
                    [record.__name__] if re.search(r"NDArray|Float|Volume|Motions|Geometry|Grain|Sample", types) else []
                )
    assert bare == []
