"""What is unusual about a scan: a level of the beam at the panel's sides, or the sample."""

from dataclasses import replace

import numpy as np
import pytest

from grainmotion.experiment.config import read_experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.experiment.inspection import scan_facts, scan_findings
from tiny_experiment import write_tiny


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return find_inputs(read_experiment(write_tiny(tmp_path_factory.mktemp("tiny"))))


def findings_at_the_sides(inputs, line_integrals):
    source = inputs.reference
    scan, pixels, _ = source.read_checked()
    scan = replace(scan, line_integrals=line_integrals(scan.line_integrals))
    found = scan_findings(source, scan_facts(source, scan, pixels, inputs.grid), inputs.grid)
    return [f for f in found if "outermost columns" in f.fact]


@pytest.mark.parametrize("level", [0.1, -0.1])
@pytest.mark.parametrize("noise", [0.0, 0.05])
def test_a_level_is_told_with_the_setting_that_takes_it_off(inputs, level, noise):
    draws = np.random.default_rng(1)
    (found,) = findings_at_the_sides(inputs, lambda p: p + level + noise * draws.normal(size=p.shape).astype(p.dtype))
    assert found.remedy == "if they see only air, set reference.air = { margin = 2 }"


def test_where_the_sample_reaches_the_sides_they_are_not_called_air(inputs):
    (found,) = findings_at_the_sides(inputs, lambda p: np.roll(p, p.shape[2] // 2, axis=2) + 0.1)
    assert "probably they see the sample" in found.fact
    assert "margin" not in found.remedy
