"""A run on a SLURM cluster:  python on_slurm.py experiment.toml

Run it on a node that is available for as long as the run takes (a login node, or a small job of its own).  It submits
jobs to the queue, each of which starts a worker, sends tasks to the workers that have started, and stops them at the
end.
"""

import sys
from pathlib import Path

from dask_jobqueue import SLURMCluster

from grainmotion.cluster.connection import ComputeConfig
from grainmotion.experiment.config import read_experiment
from grainmotion.workflow.run import run

NUMBER_OF_JOBS = 4


def workers() -> SLURMCluster:
    """Resources of each job; adapt them to your cluster."""
    return SLURMCluster(
        queue="normal",  # partition
        account="project",
        cores=16,  # of a job
        processes=1,  # one worker a job, which uses all its cores for one task at a time
        memory="64GB",
        walltime="04:00:00",
        job_script_prologue=["module load python", "source $HOME/grainmotion/bin/activate"],
        worker_extra_args=["--lifetime", "235m"],  # stop cleanly before the queue kills the job
        local_directory="$TMPDIR",  # where a worker writes data that exceed its memory
        interface=None,  # "ib0" for InfiniBand
    )


if __name__ == "__main__":
    with workers() as cluster:
        cluster.scale(jobs=NUMBER_OF_JOBS)
        cluster.wait_for_workers(1)  # others join when the queue starts their jobs
        result = run(
            read_experiment(Path(sys.argv[1])), workplace=ComputeConfig(cluster.scheduler_address), progress=print
        )
        print(f"report: {result.report}")
