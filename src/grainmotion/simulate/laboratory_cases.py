"""Hard cases as laboratories have them: cut off by the panel, between pistons, wet, soft, of many sizes.

Stones are 20 voxels across unless stated, with an SNR of 50.  Each case has one difficulty; ``plain`` has none and is
what the others are compared with.  Where a liquid fills the pores, the sample's grains have their excess of attenuation
over it (see `Sample`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from grainmotion._typing import Float
from grainmotion.model.motions import Motions
from grainmotion.model.strain import components
from grainmotion.simulate import motion_fields
from grainmotion.simulate.hard_case_record import HardCase
from grainmotion.simulate.hard_case_setup import DEFAULT_SNR, QUARTZ_SPECTRUM, Setup, absent, denser
from grainmotion.simulate.packing import PackingSettings, pack
from grainmotion.simulate.polyhedra import disc
from grainmotion.simulate.sample import Particle, Sample, Tube, ellipsoid_particle, inscribed
from grainmotion.simulate.scenarios import SMALL_SCALE, STONE_ATTENUATION, Case, Scale, Spectrum, case_of, stones
from grainmotion.simulate.shapes import extent

VOXEL = SMALL_SCALE.scanner.voxel_size  # mm
VIEWS_BY_SCALE = {"small": 45, "paper": 90}
CLEARANCE = 2.0  # between the stones' cylinder and what is around it, voxels
WALL = 4.0  # thickness, voxels
WALL_ATTENUATION = 0.3  # over the stones'
PISTON_HEIGHT, PISTON_ATTENUATION = 8.0, 2.0  # voxels; over the stones'
PISTON_STROKE = 2.0  # that the upper piston goes down, voxels
COMPRESSION = np.diag([0.01, 0.01, -0.03])  # gradient of the displacement
LIQUID_ATTENUATION = 0.4  # over the stones'
STRAIN = 0.05  # largest principal strain of each grain
CREEP = 1.0  # during the reference scan, voxels
FAINT = (0.25, 0.4)  # range of the faint stones' attenuation over that of the others
ROUND_ELONGATION = 1.4  # most that a nearly round grain is longer than wide


class Layout(NamedTuple):
    """Number of grains, radius of their cylinder in voxels, and panel in pixels."""

    grains: int
    radius: float
    panel: tuple[int, int]


PLAIN_LAYOUT: Mapping[str, Layout] = {"small": Layout(8, 24, (88, 72)), "paper": Layout(20, 32, (112, 92))}
TALL_LAYOUT: Mapping[str, Layout] = {"small": Layout(20, 24, (60, 72)), "paper": Layout(60, 32, (80, 92))}
WIDE_LAYOUT: Mapping[str, Layout] = {"small": Layout(24, 34, (104, 60)), "paper": Layout(60, 44, (130, 76))}
SIZES_LAYOUT: Mapping[str, Layout] = {"small": Layout(12, 30, (120, 88)), "paper": Layout(40, 36, (144, 100))}
GONE_LAYOUT: Mapping[str, Layout] = {"small": Layout(9, 24, (88, 72)), "paper": Layout(21, 32, (112, 92))}
COMBINED_LAYOUT: Mapping[str, Layout] = {"small": Layout(6, 24, (80, 76)), "paper": Layout(15, 32, (112, 96))}
ROUND_LAYOUT: Mapping[str, Layout] = {"small": Layout(12, 26, (104, 80)), "paper": Layout(75, 46, (168, 128))}


def plain(setup: Setup) -> HardCase:
    """Stones without any difficulty, to compare with."""
    case = _case(setup, PLAIN_LAYOUT)
    return _rigid(case, _random(case, 2.0, 6.0))


def tall(setup: Setup) -> HardCase:
    """The panel sees the middle of a longer sample, which is compressed by 3 %."""
    case = _case(setup, TALL_LAYOUT)
    return _rigid(case, _compressed(case, _random(case, 1.0, 4.0), np.zeros(3)))


def wide(setup: Setup) -> HardCase:
    """The panel is narrower than the sample (local tomography)."""
    case = _case(setup, WIDE_LAYOUT)
    radius = WIDE_LAYOUT[setup.scale_name].radius * VOXEL
    return dataclasses.replace(_rigid(case, _random(case, 1.0, 4.0)), facts={"radius": radius})


def platens(setup: Setup) -> HardCase:
    """The sample is compressed by 3 % between two dense pistons, of which the upper goes down by up to 2 voxels."""
    layout, sample = PLAIN_LAYOUT[setup.scale_name], _heap(setup, PLAIN_LAYOUT)
    low, high = _heights(sample)
    rows = 2 * round((high - low) / VOXEL / 2) + 2 * int(PISTON_HEIGHT) + 14
    layout = layout._replace(panel=(rows, layout.panel[1]))
    radius = (layout.radius + CLEARANCE) * VOXEL
    case = _case_of(setup, layout, dataclasses.replace(sample, bodies=_pistons(radius, low, high)))
    motions = _compressed(case, _random(case, 0.5, 4.0), np.array([0.0, 0.0, low]))
    moved = case.sample.moved(motions)
    later_low, later_high = _heights(moved)
    later_low, later_high = min(later_low, low), max(later_high, high - PISTON_STROKE * VOXEL)
    later = dataclasses.replace(moved, bodies=_pistons(radius, later_low, later_high))
    rises = np.array([later_low - low, later_high - high])
    strokes = dataclasses.replace(
        motion_fields.unmoved(Sample(case.sample.bodies)), translations=rises[:, None] * np.array([0.0, 0.0, 1.0])
    )
    return HardCase(case, motions, later, body_motions=strokes, facts={"stroke": float(-rises[1])})


def wet(setup: Setup) -> HardCase:
    """A liquid with 40 % of the grains' attenuation fills the pores, in both states."""
    case = _wet(setup)
    return dataclasses.replace(_rigid(case, _random(case, 2.0, 6.0)), facts=_liquid_facts())


def drains(setup: Setup) -> HardCase:
    """The pores are full of a liquid, of which the upper half is gone in the later state."""
    case = _wet(setup)
    hard = _rigid(case, _random(case, 2.0, 6.0))
    assert hard.later.tube is not None
    drained = dataclasses.replace(hard.later, tube=dataclasses.replace(hard.later.tube, top=0.0))
    return dataclasses.replace(hard, later=drained, facts={**_liquid_facts(), "level": 0.0})


def sizes(setup: Setup) -> HardCase:
    """Stones of 10 to 32 voxels together."""
    case = _case(setup, SIZES_LAYOUT, diameter=21.0, spread=0.5)
    return _rigid(case, _random(case, 2.0, 6.0))


def gone(setup: Setup) -> HardCase:
    """A third of the grains was taken out."""
    case = _case(setup, GONE_LAYOUT)
    motions, n = _random(case, 2.0, 6.0), len(case.sample)
    rows = sorted(int(row) for row in setup.draws().permutation(n)[: n // 3])
    moved = case.sample.moved(motions)
    left = tuple(p for row, p in enumerate(moved.particles) if row not in rows)
    later = dataclasses.replace(moved, particles=left)
    return HardCase(case, absent(motions, rows), later, missing=tuple(row + 1 for row in rows))


def soft(setup: Setup) -> HardCase:
    """Each grain is strained by 5 % beside its motion, at constant volume."""
    case, rng = _case(setup, PLAIN_LAYOUT), setup.draws()
    motions = _random(case, 1.0, 4.0)
    n = len(case.sample)
    tensors = np.array([_isochoric(rng) for _ in range(n)])
    motions = dataclasses.replace(motions, strains=components(tensors), strain_covariances=np.zeros((n, 6, 6)))
    maps = motions.matrices @ (np.eye(3) + tensors)
    rows = zip(case.sample.particles, maps, motions.translations, motions.centers, strict=True)
    later = dataclasses.replace(case.sample, particles=tuple(p.moved(a, u + c - a @ c) for p, a, u, c in rows))
    return HardCase(case, motions, later)


def settling(setup: Setup) -> HardCase:
    """The sample sinks by 1 voxel during the reference scan."""
    case = _case(setup, PLAIN_LAYOUT)
    return dataclasses.replace(_rigid(case, _random(case, 2.0, 6.0)), creep=(0.0, 0.0, -CREEP * VOXEL))


def materials(setup: Setup) -> HardCase:
    """Half of the grains have 0.25 to 0.4 of the others' attenuation."""
    sample, rng = _heap(setup, PLAIN_LAYOUT), setup.draws()
    faint = rng.permutation(len(sample))[: len(sample) // 2]
    shares = np.ones(len(sample))
    shares[faint] = rng.uniform(*FAINT, len(faint))
    mixed = Sample(tuple(denser(p, float(share)) for p, share in zip(sample.particles, shares, strict=True)))
    case = _case_of(setup, PLAIN_LAYOUT[setup.scale_name], mixed)
    return _rigid(case, _random(case, 2.0, 6.0))


def combined(setup: Setup) -> HardCase:
    """A wall, a polychromatic beam, a blur of 0.7 pixel, inclusions and read noise at once."""
    layout, sample, rng = COMBINED_LAYOUT[setup.scale_name], _heap(setup, COMBINED_LAYOUT), setup.draws()
    inner = (layout.radius + CLEARANCE) * VOXEL
    wall = Tube(inner, inner + WALL * VOXEL, WALL_ATTENUATION * STONE_ATTENUATION)
    filled = tuple(
        dataclasses.replace(p, inclusions=((inscribed(p.shape, rng), 1.5 * p.attenuation),))  # type: ignore[arg-type]
        for p in sample.particles
    )
    case = _case_of(setup, layout, Sample(filled, wall), QUARTZ_SPECTRUM)
    case = dataclasses.replace(case, physics=dataclasses.replace(case.physics, blur=0.7))
    return dataclasses.replace(_rigid(case, _random(case, 2.0, 6.0)), read_noise=0.004)


def round_grains(setup: Setup) -> HardCase:
    """Nearly round ellipsoids of 22 voxels, many together."""
    layout, rng = ROUND_LAYOUT[setup.scale_name], setup.draws()
    balls = [
        ellipsoid_particle(rng, 22 * VOXEL, STONE_ATTENUATION, elongation=ROUND_ELONGATION)
        for _ in range(layout.grains)
    ]
    sample = pack(balls, PackingSettings(layout.radius * VOXEL), setup.seed, setup.progress)
    case = _case_of(setup, layout, sample)
    return _rigid(case, _random(case, 2.0, 4.0))


RECIPES: Mapping[str, Callable[[Setup], HardCase]] = {
    **{
        make.__name__: make
        for make in (plain, tall, wide, platens, wet, drains, sizes, gone, soft, settling, materials, combined)
    },
    "round": round_grains,
}
LABORATORY_CASES = tuple(RECIPES)
"""Names of the hard cases that are samples as laboratories have them."""


# ---------------------------------------------------------------------- small parts
def _scale(setup: Setup, layout: Layout, diameter: float = 20.0, spread: float = 0.08) -> Scale:
    views = VIEWS_BY_SCALE[setup.scale_name]
    scanner = dataclasses.replace(SMALL_SCALE.scanner, panel=layout.panel, reference_views=views)
    return dataclasses.replace(SMALL_SCALE, scanner=scanner, diameter=diameter, radius=layout.radius, spread=spread)


def _heap(setup: Setup, layouts: Mapping[str, Layout], diameter: float = 20.0, spread: float = 0.08) -> Sample:
    """Stones packed in a cylinder."""
    layout = layouts[setup.scale_name]
    return stones(_scale(setup, layout, diameter, spread), setup.seed, layout.grains, None, setup.progress)


def _case_of(setup: Setup, layout: Layout, sample: Sample, spectrum: Spectrum = ((1.0, 1.0),)) -> Case:
    return case_of(sample, _scale(setup, layout), setup.seed, DEFAULT_SNR, spectrum)


def _case(setup: Setup, layouts: Mapping[str, Layout], diameter: float = 20.0, spread: float = 0.08) -> Case:
    """Packed stones and their scanner."""
    return _case_of(setup, layouts[setup.scale_name], _heap(setup, layouts, diameter, spread))


def _wet(setup: Setup) -> Case:
    """Packed stones in a column of liquid that is higher than the panel sees."""
    layout, sample = PLAIN_LAYOUT[setup.scale_name], _heap(setup, PLAIN_LAYOUT)
    liquid = Tube(0.0, (layout.radius + CLEARANCE) * VOXEL, LIQUID_ATTENUATION * STONE_ATTENUATION)
    excess = tuple(denser(p, 1 - LIQUID_ATTENUATION) for p in sample.particles)
    return _case_of(setup, layout, Sample(excess, liquid))


def _liquid_facts() -> dict[str, float]:
    return {"liquid_attenuation": LIQUID_ATTENUATION * STONE_ATTENUATION}


def _random(case: Case, voxels: float, degrees: float) -> Motions:
    return motion_fields.random(case.sample, voxels * VOXEL, degrees, case.seed + 1)


def _compressed(case: Case, motions: Motions, fixed: Float) -> Motions:
    """Motions with those of the compression added, which leaves the point ``fixed`` in place."""
    overall = motion_fields.affine(case.sample, COMPRESSION, fixed)
    return dataclasses.replace(motions, translations=motions.translations + overall.translations)


def _rigid(case: Case, motions: Motions) -> HardCase:
    return HardCase(case, motions, case.sample.moved(motions))


def _heights(sample: Sample) -> tuple[float, float]:
    """Lowest and highest point of the particles, mm."""
    ends = [extent(p.shape, [[0.0, 0.0, 1.0]]) for p in sample.particles]
    return min(float(low[0]) for low, _ in ends), max(float(high[0]) for _, high in ends)


def _pistons(radius: float, low: float, high: float) -> tuple[Particle, Particle]:
    """Dense discs below and above, which touch the grains."""
    thickness, attenuation = PISTON_HEIGHT * VOXEL, PISTON_ATTENUATION * STONE_ATTENUATION
    return (
        Particle(disc(radius, low - thickness, low), attenuation),
        Particle(disc(radius, high, high + thickness), attenuation),
    )


def _isochoric(rng: np.random.Generator) -> Float:
    """A random strain without change of volume to first order ``(3, 3)``, its largest principal value `STRAIN`."""
    random = rng.normal(size=(3, 3))
    strain = (random + random.T) / 2
    strain -= np.trace(strain) / 3 * np.eye(3)
    return strain * STRAIN / np.abs(np.linalg.eigvalsh(strain)).max()
