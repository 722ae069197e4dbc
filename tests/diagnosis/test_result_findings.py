"""What the motions of a state show: notes, gain, and one cause where nearly all grains fail."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import grainmotion.tracking
from grainmotion.diagnosis import results
from grainmotion.diagnosis.results import SEE_COMMON_CAUSE, check_motions, common_cause, with_common_cause
from grainmotion.model.finding import Finding, Level
from grainmotion.model.motions import Motions
from grainmotion.model.pose import ViewCorrections
from grainmotion.model.state_fit import NewGrain, StateFit
from grainmotion.model.volume import Volume
from grainmotion.tracking.body_motions import fixed_note
from grainmotion.tracking.view_alignment import ViewMisalignment
from scenes import one_body


def motions(*statuses, reasons=None, **fit):
    n = len(statuses)
    still = Motions.identity(np.arange(1, n + 1), np.zeros((n, 3)))
    reasons = reasons or tuple("" if s == "converged" else f"grain {k} is broken" for k, s in enumerate(statuses))
    return replace(still, statuses=np.array(statuses, dtype="<U20"), reasons=reasons, fit=StateFit(**fit))


def failed(n=6, good=0, status="not-converged", **fit):
    return motions(*["converged"] * good, *[status] * (n - good), **fit)


class TestCommonCause:
    @pytest.mark.parametrize(
        ("n", "good", "common"), [(6, 0, 1), (10, 2, 1), (10, 3, 0), (4, 0, 1), (3, 0, 0), (6, 6, 0)]
    )
    def test_of_nearly_all_of_several_grains(self, n, good, common):
        assert bool(common_cause(failed(n, good))) is bool(common)

    def test_many_failures_are_a_warning_that_keeps_their_reasons(self):
        (finding,) = check_motions("a", failed(10, 4))
        assert finding.level is Level.WARNING
        assert "6 of 10 grains fail" in finding.fact
        assert check_motions("a", failed(10, 5)) == ()

    def test_level_says_whether_any_grain_is_usable(self):
        assert common_cause(failed(10, 0)).level is Level.ERROR
        assert common_cause(failed(10, 1)).level is Level.WARNING

    def test_grains_with_a_usable_motion_have_not_failed(self):
        for status in ("converged", "poorly-determined", "ambiguous", "absent", "broken", "cut"):
            assert common_cause(failed(status=status)) is None

    @pytest.mark.parametrize(
        ("gain", "status", "cause"),
        [
            (0.83, "not-converged", "wrong sign"),  # gains of the cases in the docstring of PLAUSIBLE_GAINS
            (1.49, "not-converged", "wrong sign"),
            (0.0013, "not-converged", "grey values"),
            (9.8, "left-field", "grey values"),
            (1.0, "left-field", "detector_offset"),
        ],
    )
    def test_cause_follows_from_gain_and_statuses(self, gain, status, cause):
        finding = common_cause(failed(status=status, gain=gain, costs=(("end", 0.41),)))
        assert cause in finding.fact
        assert f"gain {gain:.3g}" in finding.evidence
        assert "0.41" in finding.evidence

    def test_one_reason_of_all_grains_is_the_cause(self):
        reasons = ("the equations of this state could not be solved",) * 6
        assert reasons[0] in common_cause(motions(*["not-fitted"] * 6, reasons=reasons)).fact

    def test_reason_of_each_failed_grain_names_it(self):
        before = failed(20, 1)
        after = with_common_cause(before, common_cause(before))
        assert after.reasons[0] == ""
        assert all(reason.startswith(SEE_COMMON_CAUSE) and "broken" not in reason for reason in after.reasons[1:])

    def test_one_broken_grain_may_disturb_a_small_sample(self):
        assert "broken" in common_cause(failed(6)).fact
        assert "broken" not in common_cause(failed(20)).fact

    @pytest.mark.parametrize("count", [6, 20])
    def test_a_radiograph_of_another_state_is_among_the_causes(self, count):
        assert "one of another state among them" in common_cause(failed(count)).fact

    def test_stored_motions_give_the_same_cause(self):
        before = failed(10, 1, gain=0.01)
        after = with_common_cause(before, common_cause(before))
        assert common_cause(after) == common_cause(before)

    def test_finding_made_before_tracking_is_the_cause(self):
        known = Finding(Level.WARNING, "state-geometry", "states.a", "rows flipped", "0.4, 0.03", fix="rows-flipped")
        other = Finding(Level.WARNING, "inspect", "states.a", "level")
        before = failed()
        assert common_cause(before, "states.a", (other, known)) is known
        assert check_motions("a", before, (other, known)) == ()
        assert "rows flipped" in with_common_cause(before, known).reasons[0]
        assert check_motions("a", failed(6, 6), (other, known)) == ()


class TestNotes:
    def test_each_kind_is_a_note_of_tracking(self):
        package = Path(grainmotion.tracking.__file__).parents[1]
        notes = [package / "diagnosis" / name for name in ("grain_scale.py", "state_residual.py")]
        sources = [p.read_text() for p in (*package.glob("tracking/*.py"), *notes)]
        for kind in results._KINDS:
            assert any(f'"{kind.beginning}' in source for source in sources), kind.beginning

    def test_views_that_contradict_each_other_are_a_warning(self):
        note = ViewMisalignment(1000.0, 0.8, 0.01, 30.0).note
        corrections = ViewCorrections.of(np.zeros((4, 3)))
        (finding,) = check_motions("a", failed(6, 6, notes=(note,), view_corrections=corrections))
        assert finding.level is Level.WARNING
        (refused,) = check_motions("a", failed(6, 6, notes=(note,)))
        assert refused.level is Level.NOTE
        assert finding.where == "states.a"
        assert "0.80 pixel" in str(finding)

    def test_strained_grains_are_told_where_views_contradict_each_other(self):
        note = ViewMisalignment(1000.0, 0.8, 0.01, 30.0).note
        soft = replace(failed(6, 2, "deformed", notes=(note,)), ok_translation=np.ones(6, dtype=bool))
        (finding,) = check_motions("a", soft)
        assert "strain = true" in finding.fact
        (rigid,) = check_motions("a", failed(6, 6, notes=(note,)))
        assert "strain" not in rigid.fact

    def test_grains_that_appeared_are_a_warning(self):
        new = NewGrain(np.zeros(3), np.full(3, 0.1), 0.8, 0.1, 0.1)
        (finding,) = check_motions("a", motions("converged", "absent", appeared=(new, new)))
        assert (finding.level, finding.check) == (Level.WARNING, "new-grain")
        assert "2 grains of this state are not in the reference" in finding.fact
        assert "moved there" in finding.fact

    def test_other_notes_are_notes(self):
        scene = one_body(Volume.zeros((1, 1, 1), 1.0))
        (finding,) = check_motions("a", failed(6, 6, notes=(fixed_note(scene.bodies, (0,)),)))
        assert finding.level is Level.NOTE

    def test_places_of_unexplained_attenuation_are_one_finding(self):
        notes = tuple(f"something that is no grain attenuates near x = {x}" for x in range(5))
        (finding,) = check_motions("a", failed(6, 6, notes=notes))
        assert "x = 0" in finding.fact
        assert "4 more" in finding.fact

    def test_common_cause_replaces_the_notes_that_follow_from_it(self):
        notes = ("something that is no grain attenuates near x = 1",)
        (finding,) = check_motions("a", failed(notes=notes))
        assert finding.check == "common-cause"


class TestGoodStates:
    def test_nothing_is_found(self):
        assert check_motions("a", failed(6, 6)) == ()
        assert check_motions("a", failed(6, 5)) == ()
        assert check_motions("a", motions("converged", "left-field")) == ()

    def test_round_grains_are_no_finding(self):
        reasons = ("poorly determined: rotation about any axis",) * 6
        assert check_motions("a", motions(*["poorly-determined"] * 6, reasons=reasons)) == ()

    def test_views_that_leave_a_translation_open_are_a_warning(self):
        reasons = ("poorly determined: translation along y",) * 6
        (finding,) = check_motions("a", motions(*["poorly-determined"] * 6, reasons=reasons))
        assert finding.check == "views"

    @pytest.mark.parametrize(("gain", "count"), [(0.96, 0), (1.05, 0), (0.7, 1), (1.3, 1)])
    def test_gain(self, gain, count):
        assert len(check_motions("a", failed(6, 6, gain=gain))) == count
