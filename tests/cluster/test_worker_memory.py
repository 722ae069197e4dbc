"""What a dry run says a worker needs, beside what workers of whole runs used (`validation/benchmarks/workers.py`)."""

import json
from pathlib import Path

import pytest

from grainmotion.cluster.worker_memory import ScanSize, memory_of_worker

RESULTS = Path(__file__).parents[2] / "validation" / "benchmarks" / "results"
RUNS = [
    (found["size"], int(count), max(run["peaks"][1:]))
    for found in (json.loads(path.read_text()) for path in sorted(RESULTS.glob("workers*.json")))
    for count, run in found["runs"].items()
    if int(count)
]


@pytest.mark.parametrize(("size", "workers", "peak"), RUNS)
def test_it_is_what_workers_used(size, workers, peak):
    told = memory_of_worker(ScanSize((size,) * 3, size, size, size), workers)
    assert 0.85 * peak < told < 1.2 * peak


def test_more_workers_need_less_each():
    size = ScanSize((2000,) * 3, 2000, 2000, 2000)
    needs = [memory_of_worker(size, workers) for workers in (1, 2, 8, 16)]
    assert needs == sorted(needs, reverse=True)
    assert needs[-1] < needs[0] / 10


def test_a_given_volume_has_no_slabs():
    given = ScanSize((320, 320, 320), 0, 0, 0)
    assert memory_of_worker(given, 1) <= memory_of_worker(ScanSize((320, 320, 320), 320, 320, 320), 1)
