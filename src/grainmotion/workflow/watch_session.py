"""A watch under way: what has arrived is read, checked and tracked, and the live page kept up to date."""

from __future__ import annotations

import errno
import math
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from grainmotion.errors import GrainmotionError, InputError, WriteError
from grainmotion.experiment.arrivals import complete_state
from grainmotion.experiment.inputs import start_in_file
from grainmotion.model.finding import Finding, worst_first
from grainmotion.model.motions import Motions
from grainmotion.workflow.checks import check_radiographs_of, settle
from grainmotion.workflow.context import RunContext
from grainmotion.workflow.log import STAGE_LOG
from grainmotion.workflow.reference_stages import SegmentedReference
from grainmotion.workflow.run import check_overwriting, note_motions
from grainmotion.workflow.tracking_stage import TrackedState, track_stage
from grainmotion.workflow.warm_up import warm_up
from grainmotion.workflow.watch_outputs import Say, Tracked, WatchOutputs
from grainmotion.workflow.watched_states import DONE, RETRY_SECONDS, Phase, WatchedState, WatchList, in_order


@dataclass(frozen=True)
class WatchSettings:
    """How long to watch.

    Attributes
    ----------
    every : float
        Seconds between two looks.
    until : int, optional
        States after which the watch ends; None: all of the file, or for ever where folders may still appear.
    stop_after : float, optional
        Seconds without a change of any file after which it ends.
    """

    every: float = 1.0
    until: int | None = None
    stop_after: float | None = None

    def __post_init__(self) -> None:
        if not 0 < self.every < math.inf:
            raise InputError("--every", f"got {self.every:g}", "give seconds between two looks, above 0")
        if self.until is not None and self.until < 1:
            raise InputError("--until", f"got {self.until}", "give a number of states, 1 or more")
        if self.stop_after is not None and not self.stop_after > 0:
            raise InputError("--stop-after", f"got {self.stop_after:g}", "give seconds, above 0")


@dataclass(frozen=True, eq=False)
class WatchResult:
    """How a watch ended."""

    folder: Path
    motions: dict[str, Motions]  # of the states that were tracked
    page: Path
    ended: str  # why
    interrupted: bool
    findings: tuple[Finding, ...]  # of all checks, the worst first


class WatchSession:
    """A watch under way."""

    def __init__(
        self,
        context: RunContext,
        reference: Callable[[], SegmentedReference],
        listed: WatchList,
        settings: WatchSettings,
        say: Say,
    ) -> None:
        self.context, self.reference, self.listed = context, reference, listed
        self.settings, self.say = settings, say
        self.tracked: Tracked = {}
        self.outputs = WatchOutputs(context, reference, listed, self.tracked, say)
        self.active_at = time.monotonic()

    # ------------------------------------------------------------------ the loop
    def run(self) -> WatchResult:
        """Watch until the end."""
        ended, interrupted = "interrupted", False
        try:
            self.prepare()
            ended = self.loop()
            self.outputs.catch_up()
            self.outputs.report()
        except KeyboardInterrupt:
            interrupted = True
            for state in self.listed.states:
                if state.phase == "tracking":
                    state.phase, state.message = "complete", "interrupted; another watch or run tracks it"
        STAGE_LOG.info("watch ended: %s", ended)
        self.outputs.page(ended=f"ended: {ended}")
        motions = {state.table.name: state.motions for state in self.listed.states if state.motions is not None}
        found = worst_first(self.context.findings)
        return WatchResult(self.context.folder, motions, self.outputs.page_path, ended, interrupted, found)

    def prepare(self) -> None:
        """Load the grains and compile kernels, before anything has arrived."""
        self.listed.look()
        self.outputs.page()
        self.outputs.of_reference()
        self.context.notify("preparing: grains and kernels")
        context = self.context
        with self.outputs.noted("kernels were not prepared, so that the first state takes longer"):
            warm_up(self.reference().grains, context.inputs, context.tables.track, context.tracking_backend)
        self.say(f"watching; live page: {self.outputs.page_path}")

    def loop(self) -> str:
        """Look, track what is complete, wait; returns why it ended."""
        while True:
            started = time.monotonic()
            self.context.notify("waiting for radiographs")
            changed = self.listed.look()
            ready = [state for state in self.listed.states if state.settled]
            for state in ready:
                self.read(state)
            tracked = self.track_all() if ready else False
            if changed or ready:
                self.outputs.page()
            if changed or tracked:
                self.active_at = time.monotonic()
            elif time.monotonic() > self.outputs.written_at + RETRY_SECONDS:
                self.outputs.catch_up()
            if (ended := self.end()) is not None:
                return ended
            idle = time.monotonic() - self.active_at
            if self.outputs.report_is_old and idle > self.outputs.idle_before_report:
                self.outputs.report()
            time.sleep(max(0.0, self.settings.every - (time.monotonic() - started)))

    def end(self) -> str | None:
        """Why the watch is to end; None if it goes on."""
        states, settings = self.listed.states, self.settings
        done = sum(state.phase in DONE for state in states)
        if settings.until is not None and done >= settings.until:
            return f"{done} state{'s' * (done != 1)} tracked"
        if done == len(states) and states and not self.listed.can_grow:
            return "all states of the file are tracked"
        if settings.stop_after is not None and time.monotonic() - self.active_at > settings.stop_after:
            return f"no file changed for {settings.stop_after:g} s"
        return None

    # ------------------------------------------------------------------ one state
    def read(self, state: WatchedState) -> None:
        """Read a state whose files no longer change, and check it; one that is not complete goes on waiting."""
        context, name = self.context, state.table.name
        state.used, state.source, state.motions, state.seconds = state.seen, None, None, None
        context.drop_state(name)
        self.tracked.pop(name, None)
        with self.failures(state, "arriving"):
            source = complete_state(context.experiment, state.table, context.inputs.grid)
            check_overwriting(replace(context.inputs, states=(source,)), context.folder)
            state.start = start_in_file(context.experiment.folder, state.table, context.inputs.grid)
            state.source = source
            context.set_states(in_order(self.listed.states))
            if not context.cache.is_done(f"{name}/track", context.fingerprints.tracks[name]):
                context.notify(f"{name}: reading")
                context.measured(source)  # every pixel
            state.phase, state.message = "complete", ""
        if state.source is not None:
            with self.failures(state, "error"):
                self.check(state)
        context.set_states(in_order(self.listed.states))

    def check(self, state: WatchedState) -> None:
        """Check names, frames and grey values of a state, as a run does before it tracks."""
        assert state.source is not None
        settle(self.context, state.source, state.source.findings)
        self.keep_fixes()
        check_radiographs_of(self.context, state.source)
        self.keep_fixes()

    def track_all(self) -> bool:
        """Track the states that are complete, in order, but for those whose motions are known; whether any was."""
        before = dict(self.tracked)
        for state in self.listed.states:
            if state.source is None:
                continue
            kept = self.tracked.get(state.table.name)
            if kept is None or kept[0] != self.context.fingerprints.tracks[state.table.name]:
                with self.failures(state, "error"):
                    self.track(state)
        self.outputs.of_all()
        return any(before.get(name) is not tracked for name, tracked in self.tracked.items())

    def track(self, state: WatchedState) -> None:
        """Track one state and write what `run` writes of it."""
        context, name = self.context, state.table.name
        again, state.phase = state.motions is not None, "tracking"
        self.outputs.page()
        if again:  # what was noticed when it started from other motions holds no more
            context.drop_state(name)
            context.set_states(in_order(self.listed.states))
            self.check(state)
        started, work = time.monotonic(), len(context.done)
        known = {key: tracked for key, (_, tracked) in self.tracked.items()}
        result = context.complete(track_stage(context, self.reference, name, known))()
        self.keep_fixes()
        now = time.monotonic()
        self.tracked[name] = context.fingerprints.tracks[name], result
        state.motions, state.phase, state.message = result.motions, "tracked", ""
        if name in context.refused:
            state.phase, state.message = "refused", context.refused[name].fact
        if f"{name}/track" in context.done[work:]:
            state.tracking_seconds = now - started
            state.seconds = None if again else now - state.last_change
        note_motions(context, name, result.motions)
        self.outputs.report_is_old = True
        self.say(state.line())
        self.outputs.page()
        self.outputs.of_state(state)
        self.tracked[name] = self.tracked[name][0], TrackedState(result.motions)  # without its residual radiographs
        assert state.source is not None
        context.forget(state.source)

    def keep_fixes(self) -> None:
        """Take over the geometries that checks have corrected."""
        scans = {scan.key: scan for scan in self.context.inputs.states}
        for state in self.listed.states:
            if state.source is not None:
                state.source = scans[state.source.key]

    # ------------------------------------------------------------------ errors
    @contextmanager
    def failures(self, state: WatchedState, phase: Phase) -> Iterator[None]:
        """An error inside leaves the state out, with its reason, until its files change; the watch goes on."""
        try:
            yield
            return
        except GrainmotionError as error:
            state.message = " ".join(str(error).split())
            if _of_the_drive(error):
                state.try_again(f"{state.message}; tried again after a while")
        except OSError as error:  # as a network drive that was away, or a full disk
            state.try_again(f"a file cannot be read or written ({error}); tried again after a while")
        except Exception as error:
            state.message = f"fault of the program ({type(error).__name__}: {error}); run.log has the details"
            STAGE_LOG.info("fault of the program:\n%s", traceback.format_exc())
        if state.source is not None:
            self.context.forget(state.source)
        told, state.phase, state.source, state.motions = state.phase == phase, phase, None, None
        if phase == "error" and not told:
            self.say(f"{state.table.name}: {state.message}")
        self.tracked.pop(state.table.name, None)
        self.context.set_states(in_order(self.listed.states))


def _of_the_drive(error: GrainmotionError) -> bool:
    """Whether the system failed to write a file, or to read one that is there: a full disk, a drive that is away."""
    cause = error.__cause__
    failed = isinstance(cause, OSError) and cause.errno not in (None, errno.ENOENT, errno.EINVAL)
    return failed or isinstance(error, WriteError)
