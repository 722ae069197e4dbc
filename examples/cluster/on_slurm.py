"""A run on a SLURM cluster:  python on_slurm.py experiment.toml

Run it on a node that may stay busy for as long as the run takes (a login node, or a small job of its own).  It asks
the queue for workers, hands them the work as they come, and lets them go at the end.
"""

import sys
from pathlib import Path

from dask_jobqueue import SLURMCluster

from grainmotion.cluster.connection import ComputeConfig
from grainmotion.experiment.config import read_experiment
from grainmotion.workflow.run import run

JOBS = 4


def workers() -> SLURMCluster:
    """What each job is; change it to what your cluster offers."""
    return SLURMCluster(
        queue="normal",  # partition
        account="project",
        cores=16,  # of a job
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
