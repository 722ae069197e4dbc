"""A run on a PBS cluster:  python on_pbs.py experiment.toml

Run it on a node that may stay busy for as long as the run takes (a login node, or a small job of its own).  It asks
the queue for workers, hands them the work as they come, and lets them go at the end.
"""

import sys
from pathlib import Path

from dask_jobqueue import PBSCluster

from grainmotion.cluster.connection import ComputeConfig
from grainmotion.experiment.config import read_experiment
from grainmotion.workflow.run import run

JOBS = 4


def workers() -> PBSCluster:
    """What each job is; change it to what your cluster offers."""
    return PBSCluster(
        queue="normal",
        account="project",
        resource_spec="select=1:ncpus=16:mem=64gb",
        cores=16,  # as in resource_spec
        processes=1,  # one worker a job, which uses all its cores for one task at a time
        memory="64GB",
        walltime="04:00:00",
        job_script_prologue=["module load python", "source $HOME/grainmotion/bin/activate"],
        worker_extra_args=["--lifetime", "235m"],  # leave in order before the queue kills
        local_directory="$TMPDIR",  # where a worker spills what memory does not hold
        interface=None,  # "ib0" for InfiniBand
    )


if __name__ == "__main__":
    with workers() as cluster:
        cluster.scale(jobs=JOBS)
        cluster.wait_for_workers(1)  # others join when the queue lets them
        result = run(
            read_experiment(Path(sys.argv[1])), workplace=ComputeConfig(cluster.scheduler_address), progress=print
        )
        print(f"report: {result.report}")
