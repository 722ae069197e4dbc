"""Why some inputs are not named, or not always, and which warnings on right experiments are right."""

from __future__ import annotations

REMARKS = {
    "sense-of-both-parallel": "the mirror image of the sample fits exactly as well, so the note says what to look at, "
    "and the run goes on.",
    "distance-5": "distances that are wrong alike in both scans give a sample, and motions, of another size; only the "
    "angle between the rays tells, and with a panel of 64 columns not by 25 %. "
    "[conventions.md](conventions.md#what-no-radiograph-tells) says what it does to the motions.",
    "distance-25": "likewise.",
    "misaligned-state": "right: each view is off by 0.3 pixel and 0.1° in truth, and is corrected",
    "beam-hardening": "the beam hardens, which views out of place would explain as well",
    "scatter-3": "so little light on paths this short leaves the motions right, and their standard deviations "
    "(decision 0030); dense grains suffer more, and are told.",
    "broken": "right: one grain of six broke, and no other fits beside it",
    "tall-pixels": "in a parallel beam a sample squeezed along the axis fits all radiographs of the full scan exactly; "
    "only the shapes of its grains tell.",
}
"""By the name of the row or of the experiment."""
