"""Beam hardening, or light that the sample scatters, in the line integrals of the full scan.

Both make long paths look shorter than they are: the beam gets harder on its way, or scattered light fills the shadow.
Where the views show a curve by themselves, all scans are linearised by it (`reconstruction.hardening`), and what is
left is checked here: the line integrals are compared with those of a template in which all material has one attenuation
(`preprocessing.beam_hardening`).  They look alike, and one curve corrects both.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from grainmotion._typing import Image
from grainmotion.model.finding import Check, Finding, Level
from grainmotion.model.hardening import Hardening
from grainmotion.model.large_arrays import large_zeros
from grainmotion.model.progress import counted
from grainmotion.model.scan import Scan
from grainmotion.model.slabs import slabs
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.beam_hardening import HardeningSettings, best_hardening, material_mask
from grainmotion.segmentation.blocks import Work
from grainmotion.segmentation.components import Components

HARDENING_CHECK: Check = "hardening"
HARDENING_VIEWS = 24
"""Views from which the curve is fitted, and by which this check can judge at all."""
NOTED_DEPARTURE, SERIOUS_DEPARTURE = 0.03, 0.2
"""Departure of the longest path from linear, from which it is noted, and from which it is a warning.

Hard cases and stones without scatter gave 0.000 (40 scans).  A scattered tenth of the light gave 0.05 to 0.08 on paths
of 0.7, and 0.20 to 0.24 on paths of 2.4, where errors of the motions were six times as large; the hard case of beam
hardening has 0.19."""
MAX_OTHER_SHARE = 0.09
"""Share of attenuation away from the grains from which nothing is told: a container looks like hardening (0.11 and
0.17 of the attenuation, a departure of 0.08); scattered light made 0.08 at most."""
MAX_CONTRAST = 1.5
"""Median attenuation of the densest grain over that of the faintest, from which nothing is told: the template has one
attenuation, and half of the grains at 0.25 to 0.4 of the others' looked like a departure of 0.26.  Stones of one
material gave 1.01 to 1.05, hardened by a fifth or not."""
HALO_VOXELS = 2
"""Voxels around grains that belong to them."""


def corrected_hardening(curve: Hardening, where: str = "reference") -> tuple[Finding, ...]:
    """A note if the radiographs of all scans were linearised by a curve that the full scan showed by itself.

    Parameters
    ----------
    curve : Hardening
        As of the volume, `Volume.hardening`.
    where : str
        The scan.
    """
    if curve.is_linear:
        return ()
    fact = "beam hardening, or light that the sample scatters, was corrected in all scans"
    evidence = f"{100 * curve.departure:.1f} ± {100 * curve.sd:.1f} % less at a line integral of {curve.longest:.2g}"
    remedy = "if states were taken with another beam, or are linearised already, set [reconstruct] hardening = false"
    return (Finding(Level.NOTE, HARDENING_CHECK, where, fact, evidence, remedy),)


def check_hardening(
    scan: Scan, volume: Volume, labels: NDArray[np.integer], where: str = "reference"
) -> tuple[Finding, ...]:
    """A finding if line integrals grow more slowly than paths through the grains.

    Parameters
    ----------
    scan : Scan
        Some views of the full scan, as they were reconstructed.
    volume : Volume
        Reconstructed from the scan.
    labels : (nz, ny, nx) int array
        Its grains, 0 for none.
    where : str
        The scan.
    """
    if len(scan) < HARDENING_VIEWS or not labels.any():
        return ()
    total = float(volume.array.sum(dtype=float))
    if total <= 0 or _away_from_grains(volume.array, labels) > MAX_OTHER_SHARE * total:
        return ()
    medians = [
        float(np.median(volume.array[box][labels[box] == label]))
        for label, box in enumerate(counted(ndimage.find_objects(labels)), start=1)
        if box is not None
    ]
    if max(medians) > MAX_CONTRAST * min(medians):
        return ()
    settings = HardeningSettings(degree=2)
    parts = [lambda: _pieces(material_mask(volume, settings)), lambda: _pieces(labels > 0)]
    curve = best_hardening(scan, volume, settings, parts)
    if curve.departure < NOTED_DEPARTURE:
        return ()
    level = Level.WARNING if curve.departure >= SERIOUS_DEPARTURE else Level.NOTE
    fact = "long paths attenuate less than short ones: light that the sample scatters, or beam hardening"
    evidence = f"{100 * curve.departure:.0f} ± {100 * curve.sd:.1f} % less at a line integral of {curve.longest:.2g}"
    remedy = "set [calibrate] hardening = 2, which corrects both in all scans; standard deviations may be too "
    remedy += "small without it"
    return (Finding(level, HARDENING_CHECK, where, fact, evidence, remedy),)


def _away_from_grains(array: Image, labels: NDArray[np.integer]) -> float:
    """Sum of the voxels further than `HALO_VOXELS` from all grains, some planes at a time."""
    total = 0.0
    for around, inner in slabs(len(array), HALO_VOXELS):
        near = ndimage.binary_dilation(labels[around] > 0, iterations=HALO_VOXELS)[inner]
        total += float(array[around][inner].sum(dtype=float, where=~near))
    return total


def _pieces(mask: NDArray[np.bool_]) -> NDArray[np.integer]:
    """Numbers of the connected pieces of a mask."""
    work, out = Work(), large_zeros(mask.shape, np.int32)
    found = Components.of(mask, work)
    found.paint(out, np.arange(1, len(found.sizes) + 1, dtype=np.int32), work)
    return out
