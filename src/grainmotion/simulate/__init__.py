"""Simulation without voxels: samples, motions and radiographs whose truth is known exactly.

Particles are triangle meshes or ellipsoids, their line integrals are exact chords, and pixels average
intensities, so that nothing of the tracker's own projector enters its test data.
"""

from grainmotion.simulate.cases import LATER_ANGLES_DEG, Case, Scanner, paper_scale, small
from grainmotion.simulate.packing import PackingSettings, gaps, pack
from grainmotion.simulate.physics import (
    Physics,
    Recording,
    detector_gain,
    photons_for_snr,
    record,
    record_line_integrals,
)
from grainmotion.simulate.radiograph import line_integrals, transmission
from grainmotion.simulate.sample import Particle, Sample, Tube, ellipsoid_particle
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
from grainmotion.simulate.truth import affine, random, rigid, shear_band, unmoved
from grainmotion.simulate.voxels import attenuation_volume, inside, label_volume

__all__ = [
    "LATER_ANGLES_DEG",
    "Case",
    "Ellipsoid",
    "Mesh",
    "PackingSettings",
    "Particle",
    "Physics",
    "Recording",
    "Sample",
    "Scanner",
    "Tube",
    "affine",
    "attenuation_volume",
    "detector_gain",
    "ellipsoid_particle",
    "gaps",
    "icosphere",
    "inside",
    "label_volume",
    "line_integrals",
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
