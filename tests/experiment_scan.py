"""A scan as the experiment file names it: by a scanner's file, with what else its table gives."""

from __future__ import annotations

from pathlib import Path

from grainmotion.experiment.inherited_keys import with_inherited_keys
from grainmotion.experiment.scan_files import find_scan
from grainmotion.experiment.scan_inputs import ScanInput
from grainmotion.experiment.scan_tables import ReferenceTable


def reference_scan(path: Path, **table) -> ScanInput:
    """The reference of an experiment file beside ``path``, whose radiographs are ``path`` unless told otherwise."""
    tables = with_inherited_keys({"reference": {"radiographs": [path.name], **table}})
    table = ReferenceTable.model_validate(tables["reference"])
    return find_scan("reference", table, table, path.parent)
