"""Simulation without voxels: samples, motions and radiographs whose truth is known exactly.

Particles are triangle meshes or ellipsoids, their line integrals are exact chords, and pixels average
intensities, so that nothing of the tracker's own projector enters its test data.
"""

from grainmotion.simulate.cramer_rao import motion_bounds
from grainmotion.simulate.detector import (
    Physics,
    Recording,
    detector_gain,
    photons_for_snr,
    record,
    record_line_integrals,
)
from grainmotion.simulate.fracture import broken, cut
from grainmotion.simulate.hard_case import HardCase
from grainmotion.simulate.hard_cases import HARD_CASES, hard_case
from grainmotion.simulate.misalignment import Slip, misaligned
from grainmotion.simulate.motion_fields import affine, random, rigid, shear_band, unmoved
from grainmotion.simulate.packing import PackingSettings, gaps, pack
from grainmotion.simulate.radiograph import line_integrals, transmission
from grainmotion.simulate.sample import Particle, Sample, Tube, ellipsoid_particle, inscribed
from grainmotion.simulate.scenarios import LATER_ANGLES_DEG, Case, Scanner, paper_scale, small
from grainmotion.simulate.shapes import (
    Ellipsoid,
    Mesh,
    icosphere,
    polyhedron,
    random_polyhedron,
    sphere,
    stone,
    stone_radius,
)
from grainmotion.simulate.voxelise import attenuation_volume, inside, label_volume

__all__ = [
    "HARD_CASES",
    "LATER_ANGLES_DEG",
    "Case",
    "Ellipsoid",
    "HardCase",
    "Mesh",
    "PackingSettings",
    "Particle",
    "Physics",
    "Recording",
    "Sample",
    "Scanner",
    "Slip",
    "Tube",
    "affine",
    "attenuation_volume",
    "broken",
    "cut",
    "detector_gain",
    "ellipsoid_particle",
    "gaps",
    "hard_case",
    "icosphere",
    "inscribed",
    "inside",
    "label_volume",
    "line_integrals",
    "misaligned",
    "motion_bounds",
    "pack",
    "paper_scale",
    "photons_for_snr",
    "polyhedron",
    "random",
    "random_polyhedron",
    "record",
    "record_line_integrals",
    "rigid",
    "shear_band",
    "small",
    "sphere",
    "stone",
    "stone_radius",
    "transmission",
    "unmoved",
]
