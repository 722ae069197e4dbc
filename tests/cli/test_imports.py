"""Lazy imports: `import grainmotion` and `--help` load none of the slow libraries."""

import subprocess
import sys

import pytest

SLOW_LIBRARIES = ("numba", "scipy", "skimage", "pandas", "h5py", "matplotlib", "jinja2", "dask", "tifffile")
HELP_CODE = """
from typer.testing import CliRunner
from grainmotion.cli.app import app
result = CliRunner().invoke(app, ["{}--help"])
assert result.exit_code == 0, result.output
"""


@pytest.mark.parametrize("code", ["import grainmotion", HELP_CODE.format(""), HELP_CODE.format('plan", "')])
def test_slow_libraries_are_not_loaded(code):
    program = f"{code}\nimport sys\nprint(*sorted({{m.split('.')[0] for m in sys.modules}}))"
    loaded = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True).stdout.split()
    assert not set(loaded) & set(SLOW_LIBRARIES)


def test_a_public_name_loads_its_own_module_only():
    code = "import sys, grainmotion\ngrainmotion.Geometry\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()
    assert "grainmotion.model.geometry" in loaded
    assert not {"numba", "skimage", "matplotlib"} & set(loaded)
