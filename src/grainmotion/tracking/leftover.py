"""What a state's motions leave of its radiographs."""

from __future__ import annotations

import numpy as np

from grainmotion import motion
from grainmotion.grains import GrainSet
from grainmotion.motions import Motions
from grainmotion.packed import Image, Surroundings, packed_body
from grainmotion.project import Projector, simulate_radiographs
from grainmotion.response import Response
from grainmotion.scan import Scan
from grainmotion.tracking.surroundings import background_images, corrected


def leftover(grains: GrainSet, motions: Motions, scan: Scan, projector: Projector = "trilinear") -> Image:
    """Measured − m(simulated) of each view ``(views, rows, columns)``, line integrals; NaN where a pixel is masked.

    Grains with unknown motions are left out of what is simulated.
    """
    fit, views = motions.fit, len(scan)
    around = Surroundings.still(views)
    if fit.corrections is not None:
        around = Surroundings(fit.corrections, around.translation, around.matrix)
    if fit.background is not None:
        around = Surroundings(around.views, fit.background[:3], motion.exp(fit.background[3:]))
    geometry = corrected(scan.geometry, around)
    alone = GrainSet(grains.grains)
    simulated = simulate_radiographs(alone, motions, geometry, projector)
    if grains.background is not None:
        simulated += background_images(packed_body(grains.background), around, geometry, projector, False)[0]
    response = fit.response or Response(np.full((views, 1), fit.gain), np.full((views, 1), fit.offset))
    left = scan.line_integrals - response.apply(simulated)
    if scan.valid is not None:
        left[~scan.valid] = np.nan
    return left
