"""Wrong radiographs of the later state, whose failure was put down to the grains."""

from __future__ import annotations

import numpy as np

from validation.accuracy.wrong_input.draft import Draft
from validation.accuracy.wrong_input.laboratory import strangers
from validation.accuracy.wrong_input.rows import FAILED, row

STATE = r"(error|warning).*state.*"


@row(
    "blamed",
    "state flipped left to right",
    before=FAILED,
    cause=STATE + r"(columns-flipped|start-at-180)",
    told_by="`state-geometry`, fix `columns-flipped` or its twin",
    of_state=True,
)
def state_left_right(draft: Draft) -> None:
    """Columns run the other way."""
    draft.state = draft.state[:, :, ::-1]


@row(
    "blamed",
    "state flipped up-down",
    before=FAILED,
    cause=STATE + "rows-flipped",
    told_by="`state-geometry`, fix `rows-flipped`, `first_row`",
    of_state=True,
)
def state_up_down(draft: Draft) -> None:
    """Rows run the other way."""
    draft.state = draft.state[:, ::-1]


@row(
    "blamed",
    "files of the state permuted",
    before=FAILED,
    cause=STATE + r"(are in another order|are in reverse order|angles start)",
    told_by="`state-geometry` names the order",
    of_state=True,
)
def state_permuted(draft: Draft) -> None:
    """Any other order than the right one or its reverse."""
    n = len(draft.state)
    order = np.arange(n)
    while (order == np.arange(n)).all() or (order == np.arange(n)[::-1]).all():
        order = draft.rng.permutation(n)
    draft.state = draft.state[order]


@row(
    "blamed",
    "files of the state reversed",
    before=FAILED,
    cause=STATE + r"(are in another order|are in reverse order|angles start .*wrong sign)",
    told_by="`state-geometry`, fix `order-reversed`",
    of_state=True,
)
def state_reversed(draft: Draft) -> None:
    """Last first."""
    draft.state = draft.state[::-1]


@row(
    "blamed",
    "angles of the state negated",
    before=FAILED,
    cause=STATE + r"(angles-negated|wrong sign)",
    told_by="`state-geometry`, fix `angles-negated`",
    of_state=True,
)
def state_negated(draft: Draft) -> None:
    """The other sense."""
    draft.tell_state_angles(-draft.laboratory.state_angles_deg)


@row(
    "blamed",
    "angles of the state off by 90°",
    before=FAILED,
    cause=STATE + r"angles start \d+ degrees (later|earlier)",
    told_by="`state-geometry`, fix `start-at-90` or `start-at-270`",
    of_state=True,
)
def state_off_90(draft: Draft) -> None:
    """Another start."""
    draft.tell_state_angles(draft.laboratory.state_angles_deg + draft.rng.choice([-90.0, 90.0]))


@row(
    "blamed",
    "angles of the state in radians",
    before=FAILED,
    cause=STATE + r"radian",
    told_by="`angle-table` or `state-geometry`, fix `angles-in-radians`",
    of_state=True,
)
def state_radians(draft: Draft) -> None:
    """Another unit."""
    draft.tell_state_angles(np.deg2rad(draft.laboratory.state_angles_deg))


@row(
    "blamed",
    "one radiograph of the state is black",
    before=FAILED,
    cause=STATE + "black",
    told_by="`frames`, `views`",
    of_state=True,
)
def state_black(draft: Draft) -> None:
    """The shutter was closed."""
    k = int(draft.rng.integers(len(draft.state)))
    draft.state[k] = draft.darks[0]


@row(
    "blamed",
    "radiographs of another sample",
    before=FAILED,
    cause=STATE + "another sample",
    told_by="`state-geometry`",
    of_state=True,
)
def other_sample(draft: Draft) -> None:
    """Stones of another seed in the same scanner."""
    images = strangers(draft.recipe)
    draft.state = images[:, ::-1] if draft.laboratory.draws["top"] else images
