"""Findings as JSON."""

from __future__ import annotations

import pytest

from grainmotion.errors import InputError
from grainmotion.io.findings_json import read_findings, write_findings
from grainmotion.model.finding import Finding, Level, worst_first

FINDINGS = (
    Finding(Level.NOTE, "calibration", "reference", "the axis is off", "8 pixels", "nothing to do"),
    Finding(Level.ERROR, "reference-geometry", "reference.geometry", "wrong sign", fix="angles-negated"),
)


def test_what_is_written_is_read(tmp_path):
    write_findings(tmp_path / "checks.json", FINDINGS)
    assert read_findings(tmp_path / "checks.json") == FINDINGS


@pytest.mark.parametrize("text", ["", "{", '{"a": 1}', "[1]", '[{"level": "bad"}]', '[{"level": "note"}]'])
def test_another_file_is_refused_by_name(tmp_path, text: str):
    (tmp_path / "checks.json").write_text(text)
    with pytest.raises(InputError, match="checks"):
        read_findings(tmp_path / "checks.json")


def test_worst_first_without_repetitions():
    assert worst_first([*FINDINGS, *FINDINGS]) == FINDINGS[::-1]


def test_a_finding_as_one_sentence():
    assert str(FINDINGS[0]) == "reference: the axis is off (8 pixels); nothing to do"
    assert str(FINDINGS[1]) == "reference.geometry: wrong sign"
