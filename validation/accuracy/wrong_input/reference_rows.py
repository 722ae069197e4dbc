"""Wrong full scans and wrong counts, whose failure was put down to the grains."""

from __future__ import annotations

import numpy as np

from validation.accuracy.wrong_input.draft import Draft
from validation.accuracy.wrong_input.rows import FAILED, row
from validation.accuracy.wrong_input.scan_rows import nxtomo, scattered, with_levels

REFERENCE = r"(error|warning).*reference.*"


@row(
    "blamed",
    "files of the full scan permuted",
    before=FAILED,
    cause=REFERENCE + r"order",
    told_by="`reference-geometry`: stopped, the order of the files among the causes",
)
def reference_permuted(draft: Draft) -> None:
    """Any order."""
    draft.reference = draft.reference[draft.rng.permutation(len(draft.reference))]


@row(
    "blamed",
    "files of the full scan reversed",
    before=FAILED,
    cause=REFERENCE + r"(order-reversed|reverse|angles-negated|wrong sign)",
    told_by="`reference-geometry` or `sense-of-rotation`: the sense of rotation",
    beams=("cone",),
)
def reference_reversed(draft: Draft) -> None:
    """Last first: the other sense of rotation."""
    draft.reference = draft.reference[::-1]


@row(
    "blamed",
    "the same, parallel beam: told at the state",
    before=FAILED,
    cause=r"(error|warning).*(order-reversed|reverse|angles-negated|wrong sign|columns-flipped|rows-flipped|mirror)",
    told_by="`state-geometry`: state and reference contradict each other",
    beams=("parallel",),
)
def reference_reversed_parallel(draft: Draft) -> None:
    """Last first: the mirror image is reconstructed."""
    reference_reversed(draft)


@row(
    "blamed",
    "angles of the full scan negated",
    before=FAILED,
    cause=REFERENCE + r"(angles-negated|wrong sign)",
    told_by="`sense-of-rotation`, fix `angles-negated`",
    beams=("cone",),
)
def reference_negated(draft: Draft) -> None:
    """The other sense."""
    draft.write_angles(-draft.laboratory.angles_deg)


@row(
    "blamed",
    "the same, parallel beam: told at the state",
    before=FAILED,
    cause=r"(error|warning).*(angles-negated|wrong sign|columns-flipped|rows-flipped|mirror)",
    told_by="`state-geometry`: state and reference contradict each other",
    beams=("parallel",),
)
def reference_negated_parallel(draft: Draft) -> None:
    """The mirror image is reconstructed."""
    reference_negated(draft)


@row(
    "blamed",
    "angles of the full scan in radians",
    before=FAILED,
    cause=r"(error|warning).*radian",
    told_by="`angle-table`, fix `angles-in-radians`",
)
def reference_radians(draft: Draft) -> None:
    """Another unit."""
    draft.write_angles(np.deg2rad(draft.laboratory.angles_deg))


@row(
    "blamed",
    "full scan as sinograms",
    before=FAILED,
    cause=r"(error|warning).*sinogram",
    told_by="`frames`: rows and views exchanged",
)
def sinograms(draft: Draft) -> None:
    """Row by row instead of view by view; as many views as rows, so that sizes fit."""
    draft.use_recipe(views=64)
    draft.write_angles(draft.laboratory.angles_deg)
    draft.reference = draft.reference.swapaxes(0, 1)


@row(
    "blamed",
    "one radiograph of the full scan is black",
    before=FAILED,
    cause=r"(error|warning).*(black|no transmission|hardly any beam)",
    told_by="`frames`, `views`",
)
def reference_black(draft: Draft) -> None:
    """The shutter was closed."""
    k = int(draft.rng.integers(3, len(draft.reference) - 3))
    draft.reference[k] = draft.darks[0]


def clipped(draft: Draft, limit: float) -> None:
    """Counts of a camera that is overexposed by a third."""
    for name in ("reference", "state", "flats", "darks"):
        images = getattr(draft, name).astype(float)
        open_beam = draft.recipe.photons + 100
        images = images * 1.3 * limit / open_beam
        setattr(draft, name, np.minimum(np.rint(images), limit).astype(np.uint16))


@row(
    "blamed",
    "saturation at 4095",
    before=FAILED,
    cause=r"(error|warning).*saturated",
    told_by="`saturation`, key `saturation`",
)
def saturated(draft: Draft) -> None:
    """A camera of 12 bits."""
    clipped(draft, 4095)


@row(
    "blamed",
    "a third of the flats are empty",
    before=FAILED,
    cause=r"warning.*flats left out of the mean",
    told_by="left out and told by `beam-images`",
)
def flats_empty(draft: Draft) -> None:
    """Frames that were not exposed."""
    chosen = draft.rng.permutation(len(draft.flats))[: len(draft.flats) // 3]
    draft.flats[chosen] = draft.darks[chosen]


@row(
    "blamed",
    "all flats but one taken with the shutter closed",
    before=FAILED,
    cause=r"(error|warning).*flats",
    told_by="`beam-images`",
)
def shutter_closed(draft: Draft) -> None:
    """The shutter opened late."""
    draft.flats[:-1] = draft.darks[:-1]


@row(
    "blamed", "radiographs 32,768 counts too high", before=FAILED, cause=r"(error|warning).*32,?768", told_by="`offset`"
)
def offset_32768(draft: Draft) -> None:
    """Signed numbers written as unsigned ones."""
    draft.reference, draft.state = (
        np.minimum(a.astype(int) + 32768, 65535).astype(np.uint16) for a in (draft.reference, draft.state)
    )


@row(
    "blamed",
    "two stuck columns",
    before=FAILED,
    cause=r"warning.*pixels masked.*stuck",
    told_by="masked and told by `pixels`",
)
def stuck_columns(draft: Draft) -> None:
    """They show one number whatever the beam does."""
    columns = draft.rng.choice(np.arange(16, 48), 2, replace=False)
    for images in (draft.reference, draft.state):
        for column, value in zip(columns, (9000, 30000), strict=True):
            images[:, :, column] = value


@row(
    "blamed",
    "beam varies by 10 %, recorded by a monitor (NXtomo)",
    before="the record was ignored",
    cause=r"divided by the beam monitor",
    told_by="used and told by `monitor`",
)
def monitor(draft: Draft) -> None:
    """The record of the beam."""
    levels = np.clip(1 + 0.1 * draft.rng.normal(size=len(draft.reference)), 0.6, 1.4)
    draft.reference = with_levels(draft, draft.reference, levels)
    nxtomo(draft, control__data=(1e6 * levels, "", 1e6))


@row(
    "blamed",
    "10 % scatter",
    before=FAILED,
    cause="light that the sample scatters",
    told_by="note `hardening`, `[calibrate] hardening`",
)
def scatter_10(draft: Draft) -> None:
    """Much scatter."""
    scattered(draft, 0.1)
