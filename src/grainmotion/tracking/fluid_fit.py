"""The liquid of a later state: its attenuation, its level, and what the grains add to it at their present poses.

1. *Search*: from any start the level is found under a wide filter.  The space of the liquid is cut into layers; for
   every level between two of them, and for solid and for porous grains, the attenuation follows linearly, and the
   least residual counts.
2. *Rounds*: the derivatives of the radiographs by attenuation, level and κ (see `model.fluid`) are columns that are
   eliminated at every pose, as gain and offset are.  After a fit their coefficients correct the values, and the grains
   are rebuilt at their new poses, until nothing changes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from grainmotion._typing import Float, Image
from grainmotion.model.fluid import NO_ATTENUATION, Fluid, FluidFit
from grainmotion.model.geometry import Geometry
from grainmotion.model.grains import GrainSet
from grainmotion.model.pose import Pose
from grainmotion.objective.residual import StateProblem
from grainmotion.projection.displaced_fluid import Submersion
from grainmotion.projection.grain_arrays import GrainArrays
from grainmotion.projection.volumes import project
from grainmotion.solvers.gauss_newton import Solution
from grainmotion.tracking.fluid_search import FluidValues, LevelSearch, deformed, projected_values
from grainmotion.tracking.multistage import MultistageFit
from grainmotion.tracking.strain_stages import refine_strains

SEARCH_LAYERS = 24
"""Layers of the liquid's space between which the level is sought."""
LEVEL_LAYER = 1.0
"""Half the thickness of the layer that stands for the derivative by the level, voxels: the blur of its surface."""
SEARCH_DISPLACED = (1.0, 0.0)
"""Values of κ that are tried with every level: solid grains, and grains whose pores fill and drain."""
MIN_COST_DECREASE = 0.9
"""Times the cost of the liquid as it was in the reference, below which a search takes another one."""
MIN_COLUMN = 0.02
"""Norm of the derivative by κ beside those by the gain of all grains and by the liquid, over that of a liquid in all
grains' places, below which κ keeps its value: where no grain fell dry or became wet, it is as good as a gain."""
MAX_DISPLACED = 1.5
"""Largest κ, and minus half of it the least: beyond lies only error."""
GONE = 0.02
"""Attenuation over the reference's below which the liquid is gone."""
LEVEL_FLOOR, ATTENUATION_FLOOR = 0.02, 0.005
"""Standard deviations of what voxels leave of the level (voxels) and of the attenuation (over the reference's), beside
that of noise: errors of 0.01 to 0.02 voxel and 0.2 to 0.5 % measured, where noise alone gives 0.004 voxel and 0.1 %."""
DISPLACED_FLOOR, MAX_DISPLACED_Z = 0.02, 3.0
"""Standard deviation of what voxels leave of κ, beside that of noise: errors of 0.01 to 0.04 measured; and how many of
them it may lie beyond what a share can be and still count as 0 or 1."""
MAX_FLUID_ROUNDS = 4
"""Rounds at most after each fit."""
LEVEL_TOLERANCE, ATTENUATION_TOLERANCE = 0.02, 2e-3
"""Changes of the level (voxels), of the attenuation over the reference's and of κ, that end the rounds."""


@dataclass
class FluidTracker:
    """The liquid of one state under way: it keeps grains and radiographs of a fit up to date."""

    fit: MultistageFit
    submersion: Submersion
    values: FluidValues
    unknowns: tuple[str, ...] = ()

    @classmethod
    def of(cls, fit: MultistageFit, grains: GrainSet, known: FluidFit | None = None) -> FluidTracker | None:
        """A tracker that starts with the reference's liquid, or a ``known`` one; None for a dry sample."""
        fluid = grains.scene.fluid
        if fluid is None:
            return None
        values = FluidValues(fluid.attenuation, fluid.surface)
        if known is not None:
            surface = fluid.top if np.isnan(known.level) else known.level
            values = FluidValues(
                known.attenuation, surface, values.displaced if np.isnan(known.displaced) else known.displaced
            )
        return cls(fit, Submersion(grains), values)

    @property
    def reference(self) -> Fluid:
        """The liquid of the reference."""
        return self.submersion.reference

    def fluid(self, values: FluidValues | None = None) -> Fluid:
        """The liquid of the state."""
        values = values or self.values
        return self.reference.changed(max(values.attenuation, NO_ATTENUATION), values.surface)

    # ------------------------------------------------------------------ rounds
    def place(self, pose: Pose) -> None:
        """Rebuild grains, the liquid's image and its derivatives at a pose."""
        fit, settings = self.fit, self.fit.settings
        geometry, projector = fit.target.scan.geometry, settings.projector
        fluid, strained = self.fluid(), fit.grains.stretches
        grains = self.submersion.effective(fluid, self.values.displaced, deformed(pose, self.fit.grains.stretches))
        smooth = projector == "trilinear"
        packed = (GrainArrays.of(grains, fine=f and smooth) for f in (False, True))
        fit.grains, fit.fine_grains = (
            each.on(fit.target.backend) if strained is None else each.stretched(strained) for each in packed
        )
        image = project(fluid.volume, geometry, projector=projector)
        self.unknowns, columns = self._columns(fluid, pose, geometry)
        fit.target = replace(fit.target, fluid=image, fluid_columns=columns)
        fit.levels.clear()

    def fit_with(self, pose: Pose, values: FluidValues | None = None) -> MultistageFit:
        """A copy of the fit with grains at a pose in a liquid of some values, those of the reference by default."""
        values = values or FluidValues(self.reference.attenuation, self.reference.surface)
        other = FluidTracker(replace(self.fit, levels={}), self.submersion, values)
        other.place(pose)
        return other.fit

    def projected(self, arrays: list[Image], pose: Pose) -> Image:
        """Line integrals of other values of the grains' voxels, strained as the grains are, at a pose."""
        geometry, projector = self.fit.target.scan.geometry, self.fit.settings.projector
        return projected_values(self.submersion.grains, arrays, pose, geometry, projector, self.fit.grains.stretches)

    def _columns(self, fluid: Fluid, pose: Pose, geometry: Geometry) -> tuple[tuple[str, ...], tuple[Image, ...]]:
        """Names of the unknowns that the radiographs may determine, and derivatives of the line integrals by them."""
        projector, h = self.fit.settings.projector, self.reference.space.voxel_size
        displaced, columns = self.values.displaced, dict[str, Image]()
        shaped = deformed(pose, self.fit.grains.stretches)

        def displaced_by_grains(arrays: list[Image]) -> Image:
            return self.projected(arrays, pose)

        whole = project(replace(fluid, attenuation=1.0).volume, geometry, projector=projector)
        if fluid.surface > fluid.bottom + h:
            taken = displaced_by_grains(self.submersion.wet_occupancies(fluid, shaped))
            columns["attenuation"] = whole - displaced * taken
        if fluid.bottom + h < fluid.surface < fluid.top - h:
            half = LEVEL_LAYER * h
            low, high = fluid.surface - half, fluid.surface + half
            layer = project(fluid.layer(low, high), geometry, projector=projector)
            taken = displaced_by_grains(self.submersion.wet_occupancies(replace(fluid, level=high), shaped, low))
            columns["level"] = fluid.attenuation / (2 * half) * (layer - displaced * taken)
        change = displaced_by_grains(self.submersion.changes(fluid, shaped))
        others = [displaced_by_grains([g.volume.array for g in self.submersion.grains.grains]), *columns.values()]
        scale = float(np.linalg.norm(displaced_by_grains(self._filled_occupancies())))
        if _independent_norm(change, others) > MIN_COLUMN * scale:
            columns["displaced"] = change
        return tuple(columns), tuple(columns.values())

    def _filled_occupancies(self) -> list[Image]:
        """What the reference's liquid would attenuate in all grains' places."""
        return [self.reference.attenuation * occupancy for occupancy in self.submersion.occupancies]

    def corrected(self, step: Float) -> float:
        """Correct the values by the coefficients of the columns; the largest change over its tolerance."""
        if len(step) != len(self.unknowns):
            return 0.0
        by_name = dict(zip(self.unknowns, (float(s) for s in step), strict=True))
        before, reference = self.values, self.reference
        attenuation = max(before.attenuation + by_name.get("attenuation", 0.0), 0.0)
        if attenuation < GONE * reference.attenuation:
            attenuation, by_name["level"] = 0.0, reference.bottom - before.surface
        surface = float(np.clip(before.surface + by_name.get("level", 0.0), reference.bottom, reference.top))
        displaced = before.displaced + by_name.get("displaced", 0.0)
        displaced = float(np.clip(displaced, -MAX_DISPLACED / 2, MAX_DISPLACED))
        self.values = FluidValues(attenuation, surface, displaced)
        return max(
            abs(attenuation - before.attenuation) / (ATTENUATION_TOLERANCE * reference.attenuation),
            abs(surface - before.surface) / (LEVEL_TOLERANCE * reference.space.voxel_size),
            abs(displaced - before.displaced) / ATTENUATION_TOLERANCE,
        )

    def settle(self, problem: StateProblem, solution: Solution[Pose]) -> tuple[StateProblem, Solution[Pose]]:
        """Rounds of corrections and fits under the last filter, until the values stay; strains are fitted where the
        grains have some.
        """
        for _ in range(MAX_FLUID_ROUNDS):
            evaluation = problem.evaluate(solution.state)
            change = self.corrected(evaluation.fluid_step)
            self.place(solution.state)
            fit = self.fit
            if fit.settings.strain and fit.grains.stretches is not None:
                target = replace(problem.target, fluid=fit.target.fluid, fluid_columns=fit.target.fluid_columns)
                problem, solution = refine_strains(fit, StateProblem(fit.fine_grains, target), solution)
            else:
                problem, solution = fit.solve_free(solution.state, "liquid", fit.settings.filters[-1:])
            if change < 1:
                break
        return problem, solution

    # ------------------------------------------------------------------ search
    def search(self, pose: Pose) -> None:
        """Find attenuation, level and κ under a wide filter with the grains at a pose, and place the grains there."""
        fit = self.fit
        self.place(pose)
        _, target = fit.level(fit.settings.field_filter)
        target = replace(target, fluid=None, fluid_columns=())
        reference = self.reference
        packed, strained = GrainArrays.of(self.submersion.grains), fit.grains.stretches
        packed = packed if strained is None else packed.stretched(strained)
        own = StateProblem(packed, target).evaluate(pose).line_integrals
        trial = LevelSearch(self.submersion, target, own, pose, fit.grains.stretches)
        before = trial.cost(FluidValues(reference.attenuation, reference.surface))
        best, cost = FluidValues(reference.attenuation, reference.surface), MIN_COST_DECREASE * before
        edges = np.linspace(reference.bottom, reference.top, SEARCH_LAYERS + 1)
        step = edges[1] - edges[0]
        while step > reference.space.voxel_size / 2:
            for surface in edges:
                for displaced in SEARCH_DISPLACED:
                    values, at = trial.best_attenuation(float(surface), displaced)
                    if at < cost:
                        best, cost = values, at
            step /= 3
            edges = np.clip(best.surface + step * np.array([-2, -1, 1, 2]), reference.bottom, reference.top)
        self.values = best
        self.place(pose)

    def result(self, step: Float, covariance: Float) -> FluidFit:
        """The liquid that the last fit found, with the coefficients of its columns and their covariance."""
        self.corrected(step)
        sd = dict(zip(self.unknowns, np.sqrt(np.maximum(np.diagonal(covariance), 0)), strict=False))
        values, nan = self.values, float("nan")
        full = values.surface >= self.reference.top - self.reference.space.voxel_size
        displaced_sd = float(np.hypot(sd.get("displaced", nan), DISPLACED_FLOOR))
        displaced, nearest = values.displaced, float(np.clip(values.displaced, 0.0, 1.0))
        if abs(displaced - nearest) < MAX_DISPLACED_Z * displaced_sd:
            displaced = nearest
        return FluidFit(
            values.attenuation,
            nan if full else values.surface,
            displaced if "displaced" in self.unknowns else nan,
            float(np.hypot(sd.get("attenuation", nan), ATTENUATION_FLOOR * self.reference.attenuation)),
            float(np.hypot(sd.get("level", nan), LEVEL_FLOOR * self.reference.space.voxel_size)),
            displaced_sd,
        )


def _independent_norm(image: Image, others: list[Image]) -> float:
    """Norm of what is left of an image beside its least-squares combination of others."""
    basis = np.stack([other.ravel().astype(float) for other in others], axis=1)
    flat = image.ravel().astype(float)
    return float(np.linalg.norm(flat - basis @ np.linalg.lstsq(basis, flat, rcond=1e-9)[0]))
