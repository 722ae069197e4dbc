"""The benchmark of the checks names functions where they are called: a renamed one would not be measured."""

import importlib

import pytest
from validation.benchmarks.checks import CHECKS


@pytest.mark.parametrize("name", [name for names in CHECKS.values() for name in names])
def test_measured_functions_exist(name):
    module, function = name.rsplit(".", 1)
    assert callable(getattr(importlib.import_module(f"grainmotion.{module}"), function))
