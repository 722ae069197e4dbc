"""What `grainmotion.plot` exports: it loads matplotlib late, and every example of a docstring runs."""

import doctest
import subprocess
import sys

import pytest

import grainmotion

NAMES = sorted(set(grainmotion.plot.__all__))


def test_matplotlib_is_loaded_with_the_first_figure():
    code = "import sys, grainmotion as gm\ngm.plot.motions, gm.plot.geometry\nprint('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "False\n"


@pytest.mark.parametrize("name", NAMES)
def test_its_example_runs(name):
    function = getattr(grainmotion.plot, name)
    (example,) = doctest.DocTestFinder(recurse=False).find(function, name, globs={})
    assert example.examples
    assert doctest.DocTestRunner().run(example).failed == 0


def test_public_names_hide_no_module():
    assert not [name for name in NAMES if f"grainmotion.plot.{name}" in sys.modules]
