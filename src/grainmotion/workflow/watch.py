"""Watch: each state is tracked when its radiographs are complete, for use beside the scanner.

The grains stay in memory, and kernels are compiled while nothing has arrived.  A file is complete when its size and
time are the same at two looks and it can be read in full, a state when it has as many radiographs as its geometry has
views.  States are tracked in their order; what is there makes the same results, and the same files, as `run` would of
an experiment with these states.  A state that comes late is put in its place, and those that start from it are tracked
again.  An error of one state is shown and waits for its files to change.
"""

from __future__ import annotations

from pathlib import Path

from grainmotion._typing import Progress
from grainmotion.cluster.connection import LOCAL, ComputeConfig, connect
from grainmotion.errors import InputError
from grainmotion.experiment.config import Experiment
from grainmotion.experiment.inputs import find_inputs
from grainmotion.io.files import checked_folder
from grainmotion.model.progress import listening
from grainmotion.workflow.checks import check_files, check_radiographs, check_version
from grainmotion.workflow.context import RunContext, check_inputs
from grainmotion.workflow.folder_lock import only_process
from grainmotion.workflow.given_checks import check_grains
from grainmotion.workflow.log import STAGE_LOG, run_log
from grainmotion.workflow.memory import memory_of_run
from grainmotion.workflow.provenance import StageCache
from grainmotion.workflow.reference_stages import segment_stage
from grainmotion.workflow.run import check_formats, check_overwriting, reconstructed
from grainmotion.workflow.watch_outputs import Say
from grainmotion.workflow.watch_session import WatchResult, WatchSession, WatchSettings
from grainmotion.workflow.watched_states import WatchList


def watch(
    experiment: Experiment,
    *,
    out: Path | None = None,
    settings: WatchSettings | None = None,
    progress: Progress | None = None,
    say: Say = lambda line: None,
    workplace: ComputeConfig = LOCAL,
) -> WatchResult:
    """Track each state as its radiographs arrive, until all are tracked, or by the settings, or Ctrl-C.

    ``say`` is called with a line for each state that is tracked or cannot be; errors about the reference are raised.
    """
    check_formats(experiment)
    if not experiment.tables.states and experiment.tables.watch is None:
        fact = "the file tells no state, and no [watch] folders"
        raise InputError("states", fact, 'give [[states]], or folders = "steps/*" in [watch]')
    inputs = find_inputs(experiment.with_states([]))
    folder = checked_folder(out if out is not None else experiment.output)
    check_overwriting(inputs, folder)
    with (
        listening(progress) as listener,
        connect(workplace, folder) as cluster,
        memory_of_run(inputs, folder, workplace),
    ):
        context = RunContext(experiment.with_states([]), inputs, folder, StageCache(folder), listener, cluster)
        check_files(context, states=False)
        check_inputs(context, states=False)
        with only_process(folder, context.cache), run_log(folder, experiment, inputs, "watch"):
            for finding in context.findings:
                STAGE_LOG.info(finding.line)
            check_version(context)
            check_radiographs(context, states=False)
            reference = segment_stage(context, reconstructed(context))
            check_grains(context, reference)
            if context.inputs.reference is not None:
                context.forget(context.inputs.reference)
            session = WatchSession(context, reference, WatchList(experiment), settings or WatchSettings(), say)
            return session.run()
