"""Order and series of file names: numbers with signs and decimals, dates, counters."""

import numpy as np
import pytest

from grainmotion.diagnosis.file_names import natural_order, series_of

ORDERED = {
    "counter": ["p_1.tif", "p_2.tif", "p_9.tif", "p_10.tif", "p_100.tif"],
    "zeros": ["p_0008.tif", "p_0009.tif", "p_0010.tif"],
    "dates": ["2024-05-11_10.tif", "2024-05-12_9.tif", "2024-05-12_10.tif"],
    "separated by -": ["proj-0001.tif", "proj-0002.tif", "proj-0010.tif"],
    "blank and -": ["run -0001.tif", "run -0002.tif", "run -0010.tif"],
    "signs": ["proj_-12.5.tif", "proj_-6.tif", "proj_0.tif", "proj_6.tif", "proj_12.5.tif"],
    "decimals": ["p0.75.tif", "p1.25.tif", "p1.5.tif", "p2.0.tif", "p10.0.tif"],
    "padded decimals": ["p004.5.tif", "p009.0.tif", "p045.0.tif"],
    "after a point": ["scan1.1.tif", "scan1.2.tif", "scan1.9.tif", "scan1.10.tif", "scan1.11.tif"],
    "two scans": ["scan1.1.tif", "scan1.2.tif", "scan1.10.tif", "scan2.1.tif"],
    "versions": ["v1.2.9.tif", "v1.2.10.tif"],
    "folders": ["part 2/p_1.tif", "part 10/p_0.tif"],
    "no suffix": ["a.1", "a.2", "a.10"],
}


@pytest.mark.parametrize("kind", ORDERED)
def test_order(kind):
    names = ORDERED[kind]
    shuffled = [names[k] for k in np.random.default_rng(1).permutation(len(names))]
    assert [shuffled[k] for k in natural_order(shuffled)] == names


def test_counter_beside_a_time_of_day():
    names = [f"2024-05-12_{101500 + 7 * k + k % 3}_{k:04d}.tif" for k in range(20)]
    series = series_of(names)
    assert len(series) == 1
    assert series[0].counter() == 4  # year, month, day, time, counter


def test_angles_in_names():
    assert series_of([f"proj_{a}.tif" for a in (-12.5, 0, 12.5)])[0].angles() == pytest.approx([-12.5, 0, 12.5])
    assert series_of([f"theta{a:03d}_x.tif" for a in (0, 6, 12)])[0].angles() == pytest.approx([0, 6, 12])
    assert series_of([f"a_{a:03d}deg.tif" for a in (0, 6, 12)])[0].angles() == pytest.approx([0, 6, 12])
    assert series_of([f"proj_{a:03d}.tif" for a in (0, 6, 12)])[0].angles() is None
