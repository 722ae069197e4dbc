"""Hard cases: experiments that each break one assumption of the tracker, with their truth.

`HARD_CASES` is the registry; `hard_case` makes one of them at the size of `small` or of `paper_scale`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from grainmotion._typing import Progress
from grainmotion.errors import InputError
from grainmotion.simulate import hard_case_recipes
from grainmotion.simulate.hard_case import HardCase
from grainmotion.simulate.hard_case_recipes import SCALES, Setup


@dataclass(frozen=True)
class Recipe:
    """One entry of the registry.

    Attributes
    ----------
    summary : str
        What is hard about it, in one sentence.
    make : callable
    """

    summary: str
    make: Callable[[Setup], HardCase]


HARD_CASES: Mapping[str, Recipe] = MappingProxyType(
    {
        "noisy": Recipe("Few photons: a signal-to-noise ratio of 10.", hard_case_recipes.noisy),
        "beam-hardening": Recipe(
            "Four energies: the longest path attenuates 20 % less than its length says, in both states.",
            hard_case_recipes.beam_hardening,
        ),
        "blur": Recipe("The detector blurs by a Gaussian of 1 pixel, in both states.", hard_case_recipes.blur),
        "misaligned": Recipe(
            "The panel is off by half a pixel each way and turned by half a degree in its plane, in both states, "
            "and nobody says so.",
            hard_case_recipes.misaligned,
        ),
        "misaligned-state": Recipe(
            "Each view of the later state has a shift (0.3 pixel each way) and a stage angle (0.1°) of its own "
            "that nobody tells.",
            hard_case_recipes.misaligned_state,
        ),
        "gain-drift": Recipe(
            "The beam of the later state is 10 % stronger or weaker than its flats.", hard_case_recipes.gain_drift
        ),
        "gain-drift-views": Recipe(
            "The beam differs from the flats by 10 % (standard deviation) from view to view of the later state.",
            hard_case_recipes.gain_drift_views,
        ),
        "container": Recipe(
            "A tube that the grains touch has a tenth of the sinogram's norm, and stands 3 voxels aside, "
            "grains and all, in the later state.",
            hard_case_recipes.container,
        ),
        "missing": Recipe("One grain is gone in the later state.", hard_case_recipes.missing),
        "broken": Recipe(
            "One grain broke in two halves, 6 voxels apart and turned by 15° each.", hard_case_recipes.broken
        ),
        "near-spherical": Recipe(
            "Grains are ellipsoids within 2 % of a ball, with nothing inside.", hard_case_recipes.near_spherical
        ),
        "shear-band": Recipe(
            "Twenty grains sheared along a band one grain wide, with a slip of 6 voxels.", hard_case_recipes.shear_band
        ),
    }
)


def hard_case(
    name: str,
    seed: int = 0,
    *,
    scale: Literal["small", "paper"] = "small",
    motion: Literal["unmoved", "shift", "random"] = "random",
    inclusion: float | None = None,
    progress: Progress | None = None,
) -> HardCase:
    """One of `HARD_CASES`.

    Parameters
    ----------
    name : str
    seed : int
        Of the packing, the motions, the noise, and all that the case leaves to chance.
    scale : {"small", "paper"}
        The size of `small` or of `paper_scale`; ``shear-band`` has more grains and a wider panel.
    motion : {"unmoved", "shift", "random"}
        The motion of the grains, see `Case`; ``shear-band`` has its own.
    inclusion : float, optional
        See `stones`; ``near-spherical`` and ``broken`` take none.
    progress : callable, optional

    Raises
    ------
    InputError
        If there is no such case or scale, or the case takes no inclusions.
    """
    if name not in HARD_CASES:
        raise InputError("hard case", f"'{name}' is unknown", f"choose one of {', '.join(HARD_CASES)}")
    if scale not in SCALES:
        raise InputError("scale", f"'{scale}' is unknown", f"choose one of {', '.join(SCALES)}")
    if motion not in ("unmoved", "shift", "random"):
        raise InputError("motion", f"'{motion}' is unknown", "choose unmoved, shift or random")
    if inclusion is not None and name in ("near-spherical", "broken"):
        raise InputError("inclusion", f"'{name}' takes none", "leave it out")
    recipe = HARD_CASES[name]
    made = recipe.make(Setup(seed, scale, motion, inclusion, progress))
    return dataclasses.replace(made, name=name, summary=recipe.summary)
