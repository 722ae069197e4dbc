"""What a watch writes beside the motions: outputs of each state and of all, the report, and the live page.

What cannot be written, as on a full disk, is told on the page, and tried again after a while and at the end.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from grainmotion.errors import GrainmotionError
from grainmotion.report.watch_page import WatchPage, write_watch_page
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.exports import Exporter
from grainmotion.workflow.log import STAGE_LOG
from grainmotion.workflow.outputs import (
    REPORT,
    report_stage,
    write_outputs_of_all_states,
    write_reference_exports,
    write_state_outputs,
)
from grainmotion.workflow.reference_stages import SegmentedReference
from grainmotion.workflow.results_description import describe_results
from grainmotion.workflow.tracking_stage import TrackedState
from grainmotion.workflow.watched_states import WatchedState, WatchList

WATCH_PAGE = "watch.html"
IDLE_BEFORE_REPORT = 5.0
"""Seconds without an arrival after which the report on all states is written."""
IDLE_PER_REPORT = 3.0
"""The same over the time that the last report took: it reads all radiographs again, and a state that arrives waits."""
Say = Callable[[str], None]
Tracked = dict[str, tuple[str, TrackedState]]
"""Fingerprint and motions of the states that are tracked, by name."""


class WatchOutputs:
    """The outputs of a watch; ``lacking`` says which could not be written."""

    def __init__(
        self,
        context: RunContext,
        reference: Callable[[], SegmentedReference],
        listed: WatchList,
        tracked: Tracked,
        say: Say,
    ) -> None:
        self.context, self.reference, self.listed, self.tracked, self.say = context, reference, listed, tracked, say
        self.exporter, self.page_path = Exporter(context, reference), context.folder / WATCH_PAGE
        self.notes: dict[str, str] = {}  # what failed, until it succeeds
        self.lacking: dict[str, Callable[[], None]] = {}  # what to do again, by the same names
        self.report_is_old, self.report_seconds = False, 0.0
        self.written_at = time.monotonic()

    @contextmanager
    def noted(self, what: str) -> Iterator[None]:
        """An error inside is noted on the page, until the same succeeds; the watch goes on."""
        try:
            yield
        except Exception as error:
            sentence = f"{what}: {' '.join(str(error).split())}"
            if not isinstance(error, GrainmotionError | OSError):
                STAGE_LOG.info("fault of the program:\n%s", traceback.format_exc())
            if self.notes.get(what) != sentence:
                self.notes[what] = sentence
                self.say(sentence)
        else:
            self.notes.pop(what, None)

    def catch_up(self) -> None:
        """Write what could not be written before."""
        if self.lacking:
            for write in list(self.lacking.values()):
                write()
            self.page()

    def _write(self, what: str, write: Callable[[], None]) -> None:
        """Write some outputs, those of which are there are kept; if it fails it is done again by `catch_up`."""
        self.written_at = time.monotonic()
        self.lacking[what] = lambda: self._write(what, write)
        with self.noted(what):
            write()
            del self.lacking[what]

    def of_reference(self) -> None:
        """Write volume, labels and grains of the reference for other software."""
        what = "the reference's files for other software were not written"
        self._write(what, lambda: write_reference_exports(self.context, self.exporter))

    def of_state(self, state: WatchedState) -> None:
        """Write what belongs to one state beside its motions."""
        name = state.table.name

        def write() -> None:
            if state.source is not None and name in self.tracked:
                write_state_outputs(self.context, self.exporter, state.table, state.source, self.tracked[name][1])

        self._write(f"{name}: not all outputs were written", write)

    def of_all(self) -> None:
        """Write what is made of all states, and the description of the results."""

        def write() -> None:
            states = [state.table.name for state in self.listed.states if state.source is not None]
            known = {name: self.tracked[name][1] for name in states}
            write_outputs_of_all_states(self.context, self.exporter, known)
            describe_results(self.context.folder, self.context.experiment)

        self._write("the table of all states was not written", write)

    @property
    def idle_before_report(self) -> float:
        """Seconds without an arrival after which the report is written."""
        return max(IDLE_BEFORE_REPORT, IDLE_PER_REPORT * self.report_seconds)

    def report(self) -> None:
        """Write the report on all states; their radiographs are read again, and not kept."""
        self.report_is_old, started = False, time.monotonic()
        if self.tracked:
            states = [state.table.name for state in self.listed.states if state.source is not None]
            with self.noted("the report was not written"):
                report_stage(self.context, self.reference, {name: self.tracked[name][1].motions for name in states})
            for source in self.context.inputs.states:
                self.context.forget(source)
            self.report_seconds = time.monotonic() - started
            self.page()

    def page(self, ended: str = "") -> None:
        """Write the live page; a folder that cannot be written to does not end the watch."""
        context, report = self.context, self.context.folder / REPORT
        rows, notes = [state.row() for state in self.listed.states], [*self.listed.notes, *self.notes.values()]
        name = REPORT if report.is_file() else None
        page = WatchPage(context.experiment.path.name, str(context.folder), rows, notes, name, ended)
        with self.noted("the live page was not written"):
            write_watch_page(self.page_path, page)
