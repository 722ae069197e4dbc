"""The section of the page: what wrong input gives now, and false alarms."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

from validation.accuracy import page
from validation.accuracy.wrong_input.good_cases import GOOD_CASES, GoodCase
from validation.accuracy.wrong_input.measure import SEEDS, jobs, measure, outdated, rows, verdicts
from validation.accuracy.wrong_input.remarks import REMARKS
from validation.accuracy.wrong_input.rows import BEAMS, ROWS, Group, Row
from validation.accuracy.wrong_input.verdicts import WRONG_DEG, WRONG_SDS, WRONG_VOXELS, Verdict

Found = Mapping[int, Verdict]
HEAD = ["input", "before", "named", "told in any way", "silent", "what came of it", "told by"]
TITLES: dict[Group, str] = {
    "silent": "Inputs that gave wrong motions without a word",
    "blamed": "Inputs that failed, and whose failure was put down to the grains",
}


def study() -> page.Section:
    """Measure what was not measured with the package as it is now, and tell all of it."""
    measure(outdated(jobs()))
    return section()


def section() -> page.Section:
    """The section, from the verdicts on disk."""
    wrong = {name: verdicts("wrong", name) for name in ROWS}
    good = {name: verdicts("good", name) for name in GOOD_CASES}
    trials = sum(map(len, wrong.values()))
    named = sum(ROWS[name].named(v) for name, found in wrong.items() for v in found.values())
    quiet = sum(silent(ROWS[name], v) for name, found in wrong.items() for v in found.values())
    alarms = sum(bool(v.told) for found in good.values() for v in found.values())
    experiments = sum(map(len, good.values()))
    parts = "\n".join(f"### {title}\n\n{group_table(group, wrong)}" for group, title in TITLES.items())
    text = f"""What grainmotion says of input that is wrong but plausible, and of input that is right. Each seed draws a
sample and a scanner of its own: 5 to 8 gravel stones of 14 to 18 voxels, cone beam (even seeds) or parallel beam (odd
seeds), sense of rotation, `first_row`, distances, attenuation, motions up to 3 voxels and 8°; 60 views of 64 × 64
pixels, 4 views of the later state, 20,000 photons a pixel, flats and darks. The radiographs are those of
`grainmotion.simulate`, which has no voxels, written as files and run as by `grainmotion run`. Right experiments are run
with default settings; wrong ones, to save time, with fewer sweeps, coarser grains, and without calibration and wide
search (`[calibrate] geometry = false`, `[reconstruct] sweeps = 3`, `[segment] finer = 1`, `[track] search = false`).

- *named*: an error, a warning, or where the data can tell no more a note, says what is wrong.
- *told in any way*: there is an error or a warning, of whatever content.
- *silent*: a grain that converged is off by more than {WRONG_VOXELS} voxel or {WRONG_DEG}°, and by more than
  {WRONG_SDS:.0f} own standard deviations, or is no true grain, or a grain is in no table; and nothing is told of it.
- *what came of it*: stopped: nothing was computed from it; right: all grains that converged are right;
  wrong: some are not, or are in no table.

{progress(wrong, good)}{parts}
{remarks(wrong)}### False alarms

Right experiments, some of them odd, all run with default settings to the motions. Nothing but notes should be told.

{good_table(good)}"""
    headline = (
        f"{named} of {trials} wrong inputs of {len(ROWS)} kinds named, {quiet} silent; "
        f"{alarms} of {experiments} right experiments with a warning or an error"
    )
    return page.Section("Wrong input", text, headline)


def progress(wrong: Mapping[str, Found], good: Mapping[str, Found]) -> str:
    """What has not been run yet."""
    left = sum(len(row.seeds(SEEDS)) - len(wrong[row.name]) for row in rows())
    left += sum(case.seeds - len(good[name]) for name, case in GOOD_CASES.items())
    sources = {v.source for found in (*wrong.values(), *good.values()) for v in found.values()}
    mixed = len(sources) > 1
    versions = f"The trials were made with {len(sources)} successive versions of the package.\n\n" if mixed else ""
    if not left:
        return versions
    return (
        versions
        + f"Not all of the {SEEDS} seeds a row are run yet, {left} trials are left; the command below continues.\n\n"
    )


def silent(row: Row, verdict: Verdict) -> bool:
    """Whether something is wrong and nothing says so."""
    return verdict.silent and not row.named(verdict)


def group_table(group: Group, wrong: Mapping[str, Found]) -> str:
    """One of the two tables."""
    return page.table(HEAD, [cells(row, wrong[row.name]) for row in rows() if row.group == group])


def cells(row: Row, found: Found) -> list[str]:
    """A row, for its table."""
    n = len(found)
    named = {seed: row.named(v) for seed, v in found.items()}
    told = sum(bool(v.told) or named[seed] for seed, v in found.items())
    came = Counter(outcome_of(v) for v in found.values())
    quiet = sum(silent(row, v) for v in found.values())
    outcome = ", ".join(f"{count} {what}" for what, count in came.most_common())
    return [row.text, row.before, by_beam(named), f"{told} of {n}", str(quiet), outcome, row.told_by]


def outcome_of(verdict: Verdict) -> str:
    """What came of an input, in a word."""
    if verdict.stopped:
        return "stopped"
    if verdict.right:
        return "right"
    return "wrong" if verdict.converged else "none converged"


def by_beam(named: Mapping[int, bool]) -> str:
    """How often the cause was named, by beam where that differs."""
    total = f"{sum(named.values())} of {len(named)}"
    parts = {beam: [yes for seed, yes in named.items() if seed % 2 == k] for k, beam in enumerate(BEAMS)}
    shares = {beam: sum(some) / len(some) for beam, some in parts.items() if some}
    if len(shares) < 2 or len(set(shares.values())) == 1:
        return total
    return f"{total} ({', '.join(f'{beam} {sum(parts[beam])} of {len(parts[beam])}' for beam in BEAMS)})"


def remarks(wrong: Mapping[str, Found]) -> str:
    """Why some are not named."""
    lines = [f"- {ROWS[name].text}: {text}" for name, text in REMARKS.items() if wrong.get(name)]
    return "Where it is not named, and why:\n\n" + "\n".join(lines) + "\n\n" if lines else ""


def good_table(good: Mapping[str, Found]) -> str:
    """The table of false alarms."""
    rows = [[*alarm_cells(case, good[name])] for name, case in GOOD_CASES.items()]
    return page.table(["experiment", "seeds", "errors", "warnings", "grains converged, wrong", "what is told"], rows)


def alarm_cells(case: GoodCase, found: Found) -> list[str]:
    """A right experiment, for the table."""
    told = [line for v in found.values() for line in v.told]
    errors = sum(line.startswith("error") for line in told)
    checks = Counter(f"`{m[1]}`" for line in told if (m := re.search(r"\[([a-z-]+)\](?: \{.*\})?$", line)))
    words = ", ".join(f"{check} {n} times" for check, n in checks.most_common()) or "–"
    converged, wrong = sum(v.converged for v in found.values()), sum(v.wrong + v.extra for v in found.values())
    remark = REMARKS.get(case.name, "")
    return [
        f"*{case.name}*: {case.text}",
        str(len(found)),
        str(errors),
        str(len(told) - errors),
        f"{converged}, {wrong}",
        f"{words}{': ' + remark if remark and told else ''}",
    ]
