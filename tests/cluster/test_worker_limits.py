"""What a dry run tells of the workers of a real scheduler, and of those that a run would start."""

import json

import pytest
from typer.testing import CliRunner

from dask_workers import scheduler
from grainmotion.cli.app import app
from grainmotion.cluster.connection import ComputeConfig, connect
from grainmotion.cluster.worker_limits import limits_of_workers
from tiny_experiment import write_tiny

distributed = pytest.importorskip("distributed")


@pytest.fixture(scope="module")
def experiment(tmp_path_factory):
    return write_tiny(tmp_path_factory.mktemp("limits") / "tiny")


@pytest.fixture(scope="module")
def two_workers():
    """The address of a scheduler with two workers, one of which has less memory than any run needs."""
    with scheduler() as workers, distributed.Client(workers.start("4GB").start("0.3GB").address) as client:
        client.wait_for_workers(2, timeout=900)
        yield workers.address


def dry_run(experiment, *options, code=0):
    result = CliRunner().invoke(app, ["run", str(experiment), "--dry-run", *options])
    assert result.exit_code == code, result.output
    return result


def test_each_worker_of_a_scheduler_is_told(experiment, two_workers):
    told = dry_run(experiment, "--scheduler", two_workers).stdout
    assert "workers: 2; threads of each: 1; memory that each may use: 0.30 to 4.00 GB\n" in told
    (warning,) = [line for line in told.splitlines() if line.startswith("warning")]
    assert "1 of 2 workers has too little memory: 0.30 GB (tcp://" in warning
    assert "dask worker --memory-limit" in warning
    assert not (experiment.parent / "results").exists()


def test_json_has_each_worker(experiment, two_workers):
    result = json.loads(dry_run(experiment, "--scheduler", two_workers, "--json").stdout)["result"]
    assert sorted(worker["memory_limit"] for worker in result["workers"]) == [int(0.3e9), int(4e9)]
    assert all(worker["address"].startswith("tcp://") for worker in result["workers"])
    for worker in result["workers"]:
        assert worker["threads"] == 1
        assert worker["enough"] == (worker["memory_limit"] > result["memory_of_worker"])


def test_a_scheduler_without_workers_is_said_to_have_none(experiment):
    with scheduler() as empty:
        told = dry_run(experiment, "--scheduler", empty.address).stdout
    assert "warning: the scheduler has no workers yet" in told
    assert "workers: " not in told


def test_a_scheduler_that_does_not_answer_is_refused_as_by_a_run(experiment, monkeypatch):
    monkeypatch.setattr("grainmotion.cluster.connection.SECONDS_TO_ANSWER", 1)
    errors = [
        CliRunner().invoke(app, ["run", str(experiment), *dry, "--scheduler", "tcp://127.0.0.1:9", "-q"])
        for dry in (["--dry-run"], [])
    ]
    assert [error.exit_code for error in errors] == [2, 2]
    assert errors[0].stderr == errors[1].stderr
    (line,) = errors[0].stderr.splitlines()
    assert "no Dask scheduler answers there" in line
    assert "start one with `dask scheduler`" in line


def test_workers_to_be_started_are_told_as_dask_starts_them(experiment, tmp_path):
    place = ComputeConfig(workers=2)
    with connect(place, tmp_path) as connection:
        client = connection.executor.client
        started = client.sync(client.scheduler.identity)["workers"].values()
    assert [(w["nthreads"], w["memory_limit"]) for w in started] == [
        (limits.threads, int(limits.memory)) for limits in limits_of_workers(place)
    ]


@pytest.mark.parametrize(("memory", "short"), [("8GB", False), ("0.2GB", True)])
def test_memory_of_workers_to_be_started_is_compared(experiment, memory, short):
    told = dry_run(experiment, "--workers", "2", "--memory", memory).stdout
    assert f"memory that each may use: {float(memory[:-2]):.2f} GB" in told
    assert ("warning: 2 of 2 workers have too little memory: 0.20 GB, where each needs" in told) == short
