"""Example scripts for SLURM and PBS: the jobs they submit, and a run with a substitute for the queue."""

import importlib.util
import runpy
import stat
import sys
from pathlib import Path

import pytest

from grainmotion.io.motions_csv import read_motions
from tiny_experiment import TOML, write_tiny

pytest.importorskip("dask_jobqueue")
EXAMPLES = Path(__file__).parents[2] / "examples" / "cluster"
SUBMIT = {"on_slurm": "sbatch", "on_pbs": "qsub"}
CANCEL = {"on_slurm": "scancel", "on_pbs": "qdel"}
EXPECTED = {
    "on_slurm": ["#SBATCH -p normal", "#SBATCH -A project", "#SBATCH --cpus-per-task=16", "#SBATCH -t 04:00:00"],
    "on_pbs": ["#PBS -q normal", "#PBS -A project", "#PBS -l select=1:ncpus=16:mem=64gb", "#PBS -l walltime=04:00:00"],
}


def load(name):
    """Import the example script of this name."""
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", EXPECTED)
def test_job_script(name):
    with load(name).workers() as cluster:
        script = cluster.job_script()
    for line in [*EXPECTED[name], "source $HOME/grainmotion/bin/activate"]:
        assert line in script.splitlines()
    assert "distributed.cli.dask_worker" in script
    for option in ("--nthreads 16", "--memory-limit 59.60GiB", "--lifetime 235m", "--local-directory $TMPDIR"):
        assert option in script


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPECTED)
def test_run_through_a_queue(name, tmp_path, monkeypatch):
    """The substitute queue starts every submitted job at once on this computer."""
    commands = tmp_path / "bin"
    commands.mkdir()
    jobs = tmp_path / "jobs"
    submit = f"""#!/bin/sh
for file in "$@"; do :; done
cp "$file" "{jobs}.sh"
sh "{jobs}.sh" > "{jobs}.log" 2>&1 &
echo $! > "{jobs}"
echo "job $!"
"""
    for command, text in ((SUBMIT[name], submit), (CANCEL[name], "#!/bin/sh\n")):
        path = commands / command
        path.write_text(text)
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(commands), prepend=":")
    toml = write_tiny(tmp_path / "tiny", TOML.replace("search = false", "search = false\niterations = 3"))
    text = (EXAMPLES / f"{name}.py").read_text()
    small = text.replace("cores=16", "cores=1").replace("64GB", "2GB").replace("JOBS = 4", "JOBS = 1")
    small = small.replace('["module load python", "source $HOME/grainmotion/bin/activate"]', "[]")
    (tmp_path / f"{name}.py").write_text(small.replace('local_directory="$TMPDIR"', f'local_directory="{tmp_path}"'))
    monkeypatch.setattr(sys, "argv", [name, str(toml)])
    runpy.run_path(str(tmp_path / f"{name}.py"), run_name="__main__")
    assert jobs.is_file()  # the job was submitted to the queue
    assert len(read_motions(toml.parent / "results" / "two" / "motions.csv")) == 3
