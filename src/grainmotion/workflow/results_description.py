"""The description of a results folder, ``datapackage.json``, from the stages that are done."""

from __future__ import annotations

import json
from pathlib import Path

from grainmotion.experiment.config import Experiment
from grainmotion.io.data_package import write_data_package
from grainmotion.workflow.log import RUN_LOG
from grainmotion.workflow.provenance import STAGES_FILE, StageCache

_PLAN_FILES = ("plan/plan.csv", "plan/angles.csv", "plan/plan.png")


def describe_results(folder: Path, experiment: Experiment) -> None:
    """Describe the files of finished stages, and of a plan if there is one."""
    others = (folder / name for name in (STAGES_FILE, RUN_LOG, *_PLAN_FILES))
    paths = [path for path in (*StageCache(folder).all_files(), *others) if path.is_file()]
    settings = json.loads(experiment.tables.model_dump_json())
    write_data_package(folder, paths, {"experiment": experiment.path.name, **settings})
