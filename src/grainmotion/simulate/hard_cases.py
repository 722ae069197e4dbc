"""Hard cases: experiments that each violate one assumption of the tracker, with their true motions.

One function makes each case; those of `simulate.laboratory_cases` are samples as laboratories have them.  `HARD_CASES`
is the registry of all, and `hard_case` makes one of them, small or larger.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from scipy.optimize import brentq

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.model.motions import Status
from grainmotion.rotations import rotation_matrix
from grainmotion.simulate import fracture, motion_fields
from grainmotion.simulate.hard_case_record import HardCase
from grainmotion.simulate.hard_case_setup import (
    DEFAULT_SNR,
    GRAINS_BY_SCALE,
    QUARTZ_SPECTRUM,
    SCALES,
    Setup,
    absent,
    denser,
    marked,
    rigid_case,
)
from grainmotion.simulate.laboratory_cases import LABORATORY_CASES, RECIPES
from grainmotion.simulate.misalignment import Misalignment
from grainmotion.simulate.packing import PackingSettings, pack
from grainmotion.simulate.sample import Sample, Tube, ellipsoid_particle
from grainmotion.simulate.scenarios import STONE_ATTENUATION, case_of, later_radiographs, stones

SHEAR_BAND_LAYOUT = {"small": ((112, 96), 34.0), "paper": ((280, 220), 72.0)}  # panel, radius of the cylinder in voxels
HARDENING_DROP = 0.2  # share of the line integral that hardening takes off along the longest path


def noisy(setup: Setup) -> HardCase:
    """Few photons: a signal-to-noise ratio of 10."""
    return rigid_case(setup, setup.case(snr=10.0))


def beam_hardening(setup: Setup) -> HardCase:
    """Four energies: the longest path attenuates 20 % less than one energy would, in both states."""
    sample = setup.sample()
    longest = float(later_radiographs(sample, setup.scale).max())
    shares, ratios = np.array(QUARTZ_SPECTRUM).T
    ratios = ratios / (shares @ ratios)  # thin paths have the nominal attenuation

    def drop(path: float) -> float:
        return 1 + float(np.log(shares @ np.exp(-ratios * path))) / path

    longest_path = brentq(lambda path: drop(path) - HARDENING_DROP, 1e-3, 50.0)
    dense = Sample(tuple(denser(p, longest_path / longest) for p in sample.particles))
    spectrum = tuple((float(s), float(r)) for s, r in zip(shares, ratios, strict=True))
    case = case_of(dense, setup.scale, setup.seed, DEFAULT_SNR, spectrum)
    return dataclasses.replace(rigid_case(setup, case), facts={"longest_path": longest_path, "drop": HARDENING_DROP})


def blur(setup: Setup) -> HardCase:
    """The detector blurs by a Gaussian of 1 pixel, in both states."""
    case = setup.case()
    return rigid_case(setup, dataclasses.replace(case, physics=dataclasses.replace(case.physics, blur=1.0)))


def misaligned(setup: Setup) -> HardCase:
    """The panel is off by half a pixel each way and by half a degree in its plane, in both states; the nominal geometry
    does not include it.
    """
    return dataclasses.replace(rigid_case(setup, setup.case()), misalignment=Misalignment((0.5, 0.5), turn_deg=0.5))


def misaligned_state(setup: Setup) -> HardCase:
    """Each view of the later state has its own shift (0.3 pixel each way) and stage angle (0.1°) that the nominal
    geometry does not include.
    """
    return dataclasses.replace(
        rigid_case(setup, setup.case()), view_misalignment=Misalignment((0.3, 0.3), stage_deg=0.1)
    )


def gain_drift(setup: Setup) -> HardCase:
    """The beam of the later state is 10 % stronger or weaker than its flats."""
    gain = float(setup.draws().choice([0.9, 1.1]))
    return dataclasses.replace(rigid_case(setup, setup.case()), gain=gain, facts={"gain": gain})


def gain_drift_views(setup: Setup) -> HardCase:
    """The beam differs from the flats by 10 % (standard deviation) from view to view of the later state."""
    return dataclasses.replace(rigid_case(setup, setup.case()), gain_spread=0.1)


def container(setup: Setup) -> HardCase:
    """A tube that the grains touch has a tenth of the sinogram's norm; in the later state it and all grains are 3
    voxels to the side.
    """
    sample = setup.sample()
    inner = setup.scale.radius * setup.voxel
    wall = Tube(inner, 1.1 * inner, 1.0)
    norms = [np.linalg.norm(later_radiographs(s, setup.scale)) for s in (sample, Sample((), wall))]
    wall = dataclasses.replace(wall, attenuation=float(0.1 * norms[0] / norms[1]))
    case = case_of(Sample(sample.particles, wall), setup.scale, setup.seed, DEFAULT_SNR)
    angle = setup.draws().uniform(0, 2 * np.pi)
    shift = 3 * setup.voxel * np.array([np.cos(angle), np.sin(angle), 0.0])
    motions = case.motions[setup.motion]
    motions = dataclasses.replace(motions, translations=motions.translations + shift)
    later = Sample(case.sample.moved(motions).particles, wall.moved(np.eye(3), shift))
    facts = {"tube_shift_x": float(shift[0]), "tube_shift_y": float(shift[1]), "norm_share": 0.1}
    return HardCase(case, motions, later, facts=facts)


def missing(setup: Setup) -> HardCase:
    """One grain is missing in the later state."""
    case = setup.case()
    row = int(setup.draws().integers(len(case.sample)))
    motions = case.motions[setup.motion]
    moved = case.sample.moved(motions)
    rest = Sample(moved.particles[:row] + moved.particles[row + 1 :], moved.tube)
    truth = absent(motions, [row])
    return HardCase(case, truth, rest, missing=(row + 1,))


def broken(setup: Setup) -> HardCase:
    """One grain broke in two halves, 6 voxels apart and rotated by 15° each."""
    case, rng = setup.case(), setup.draws()
    row = int(rng.integers(len(case.sample)))
    motions = case.motions[setup.motion]
    moved = case.sample.moved(motions)
    normal = rng.normal(size=3) * [1.0, 1.0, 0.5]  # the halves part sideways rather than up
    normal /= np.linalg.norm(normal)
    halves = []
    for half, side in zip(fracture.broken(moved.particles[row], normal), (1, -1), strict=True):
        axis = rng.normal(size=3)
        rotation = rotation_matrix(np.deg2rad(15.0) * (axis / np.linalg.norm(axis)))
        halves.append(half.moved(rotation, half.center - rotation @ half.center + side * 3 * setup.voxel * normal))
    later = Sample((*moved.particles[:row], *halves, *moved.particles[row + 1 :]), moved.tube)
    truth = marked(motions, [row], Status.BROKEN, "it broke in two; the motion is the whole grain's before")
    return HardCase(case, truth, later, broken=(row + 1,), facts={"apart": 6 * setup.voxel, "turn_deg": 15.0})


def near_spherical(setup: Setup) -> HardCase:
    """Grains are ellipsoids within 2 % of a ball, without inclusions."""
    rng, diameter = np.random.default_rng(setup.seed), setup.scale.diameter * setup.voxel
    n = GRAINS_BY_SCALE[setup.scale_name]
    sizes = diameter * (1 + 0.08 * rng.uniform(-1, 1, n))
    balls = [ellipsoid_particle(rng, size, STONE_ATTENUATION, elongation=1.02) for size in sizes]
    sample = pack(balls, PackingSettings(setup.scale.radius * setup.voxel), setup.seed, setup.progress)
    return rigid_case(setup, case_of(sample, setup.scale, setup.seed, DEFAULT_SNR))


def shear_band(setup: Setup) -> HardCase:
    """Twenty grains sheared along a band one grain wide, with a slip of 6 voxels."""
    panel, radius = SHEAR_BAND_LAYOUT[setup.scale_name]
    scanner = dataclasses.replace(setup.scale.scanner, panel=panel)
    scale = dataclasses.replace(setup.scale, scanner=scanner, radius=radius)
    sample = stones(scale, setup.seed, 20, setup.inclusion, setup.progress)
    case = case_of(sample, scale, setup.seed, DEFAULT_SNR)
    angle = setup.draws().uniform(0, 2 * np.pi)
    about_z = rotation_matrix([0.0, 0.0, angle])
    normal, direction = about_z @ np.array([0.0, 0.5, 1.0]), about_z @ np.array([0.0, 1.0, -0.5])
    size = 6 * setup.voxel
    motions = motion_fields.shear_band(sample, size, scale.diameter * setup.voxel, normal=normal, direction=direction)
    return HardCase(case, motions, sample.moved(motions), facts={"slip": size})


class Recipe(NamedTuple):
    """One entry of the registry: why the case is hard, in one sentence, and the function that makes it."""

    summary: str
    make: Callable[[Setup], HardCase]


# The name of a case is that of its function, with hyphens, and its summary is the function's docstring.
_FUNCTIONS: Mapping[str, Callable[[Setup], HardCase]] = {
    **{
        make.__name__.replace("_", "-"): make
        for make in (
            noisy, beam_hardening, blur, misaligned, misaligned_state, gain_drift, gain_drift_views, container, missing,
            broken, near_spherical, shear_band,
        )
    },
    **RECIPES,
}  # fmt: skip
HARD_CASES: Mapping[str, Recipe] = MappingProxyType(
    {name: Recipe(" ".join((make.__doc__ or "").split()), make) for name, make in _FUNCTIONS.items()}
)
"""Cases by name, each with the function that makes it; `hard_case` makes one."""


@checked_arguments
def hard_case(
    name: str,
    seed: int = 0,
    *,
    scale: Literal["small", "paper"] = "small",
    motion: Literal["unmoved", "shift", "random"] = "random",
    inclusion: float | None = None,
    progress: Progress | None = None,
) -> HardCase:
    """Make one of `HARD_CASES`.

    Parameters
    ----------
    name : str
        Key of the registry.
    seed : int
        Seed of the packing, the motions, the noise, and whatever is random in the case.
    scale : {"small", "paper"}
        The size of `small` or of `paper_scale`; ``shear-band`` has more grains and a wider panel.  Samples of
        `LABORATORY_CASES` have stones of 20 voxels at both: 6 to 24 seen in 45 views, or 15 to 75 in 90.
    motion : {"unmoved", "shift", "random"}
        The motion of the grains, see `Case`; ``shear-band`` and laboratory samples have their own.
    inclusion : float, optional
        As in `small`; ``near-spherical``, ``broken`` and laboratory samples take none.
    progress : callable, optional
        Called as ``progress(message, done, total)``.

    Returns
    -------
    HardCase
        Both states with their true motions.

    Raises
    ------
    InputError
        If there is no such case, scale or motion, or the case takes no inclusions.

    Examples
    --------
    >>> case = gm.simulate.hard_case("noisy")
    >>> case.summary
    'Few photons: a signal-to-noise ratio of 10.'
    """
    if name not in HARD_CASES:
        raise InputError("hard case", f"'{name}' is unknown", f"choose one of {', '.join(HARD_CASES)}")
    if scale not in SCALES:
        raise InputError("scale", f"'{scale}' is unknown", f"choose one of {', '.join(SCALES)}")
    if motion not in ("unmoved", "shift", "random"):
        raise InputError("motion", f"'{motion}' is unknown", "choose unmoved, shift or random")
    if inclusion is not None and name in ("near-spherical", "broken", *LABORATORY_CASES):
        raise InputError("inclusion", f"'{name}' takes none", "leave it out")
    recipe = HARD_CASES[name]
    case = recipe.make(Setup(seed, scale, motion, inclusion, progress))
    return dataclasses.replace(case, name=name, summary=recipe.summary)
