"""What is loaded before any work: `import grainmotion` and `--help` stay quick because they load none of the rest."""

import subprocess
import sys

import pytest

HEAVY = ("numba", "scipy", "skimage", "pandas", "h5py", "matplotlib", "plotly", "jinja2", "dask", "tifffile")
HELP = """
from typer.testing import CliRunner
from grainmotion.cli.app import app
result = CliRunner().invoke(app, ["{}--help"])
assert result.exit_code == 0, result.output
"""


@pytest.mark.parametrize("code", ["import grainmotion", HELP.format(""), HELP.format('plan", "')])
def test_nothing_heavy_is_loaded(code):
    printed = f"{code}\nimport sys\nprint(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    loaded = subprocess.run([sys.executable, "-c", printed], check=True, capture_output=True, text=True).stdout.split()
    assert not set(loaded) & set(HEAVY)


def test_a_name_loads_its_own_module_only():
    code = "import sys, grainmotion\ngrainmotion.Geometry\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert "grainmotion.model.geometry" in loaded
    assert not {"numba", "skimage", "plotly", "matplotlib"} & set(loaded)
