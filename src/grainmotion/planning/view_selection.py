"""The best set of views: all pairs are tried; from there views are added one by one and exchanged.

Exchange starts twice, from the best set of one view less with the view that helps most, and from the best of all
even sets, and the better end counts.

The criterion is the geometric mean over the grains of the sd of their surface's displacement (see
`Candidates.surface_sd`): a length that joins translation and rotation, and a mean that a single round grain, whose
rotation no set of views determines, cannot dominate.

Two views along one line, from the same side or from opposite ones, do not enter one set: the second would lower the
photon noise of the first, but repeat its model error, and the ranges of capture were measured with views apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from grainmotion._typing import Float, Progress
from grainmotion.planning.candidates import angles_between, even_set
from grainmotion.planning.fisher_information import Candidates, invert
from grainmotion.solvers.block_cg import diagonal_blocks

MAX_COUPLED_OPERATIONS = 1e11
"""Operations for all pairs of views, up to which the choice keeps the coupling between grains."""
MAX_EXCHANGE_PASSES = 10


@dataclass(frozen=True, eq=False)
class ViewSelector:
    """The information of all candidates, summed over many sets of views.

    Attributes
    ----------
    candidates : Candidates
    stacks : (m, s, s) or (m, n, 6, 6) array
        Each candidate's full matrix; or, for many grains, their own blocks, neighbours being fixed.
    borders, corners : (m, n, 6, 2) and (m, 2, 2) arrays
        Of gain and offset.
    between : (m, m) array
        Angles between views as lines, degrees.
    """

    candidates: Candidates
    stacks: Float
    borders: Float
    corners: Float
    between: Float

    @classmethod
    def of(cls, candidates: Candidates, progress: Progress | None = None) -> ViewSelector:
        """Compute every candidate's information once."""
        m, n = len(candidates.geometry), len(candidates.grain_arrays)
        dense = m**2 / 2 * (6.0 * n) ** 3 <= MAX_COUPLED_OPERATIONS
        stacks, borders, corners = [], [], []
        for view in range(m):
            if progress is not None:
                progress("information of each view", view, m)
            information = candidates.information(view)
            matrix = information.dense(candidates.settings.gain) if dense else diagonal_blocks(information.matrix)
            stacks.append(matrix)
            borders.append(information.border.reshape(n, 6, 2))
            corners.append(information.corner)
        between = angles_between(candidates.geometry)
        return cls(candidates, np.array(stacks), np.array(borders), np.array(corners), between)

    @property
    def coupled(self) -> bool:
        """Whether the coupling between grains is kept."""
        return self.stacks.ndim == 3

    def __len__(self) -> int:
        return len(self.stacks)

    def surface_sd(self, views: Sequence[int]) -> Float:
        """Predicted sd ``(n,)`` of each grain's surface from a set of views, mm."""
        index, c = list(views), self.candidates
        total = self.stacks[index].sum(axis=0)
        if self.coupled:
            return c.surface_sd(c.clean(invert(total, c.prior)))
        if c.settings.gain:
            border, corner = self.borders[index].sum(axis=0), self.corners[index].sum(axis=0) + np.eye(2)
            total = total - border @ np.linalg.solve(corner, np.swapaxes(border, 1, 2))
        return c.surface_sd(c.clean(np.linalg.inv(total + c.prior[:, :, None] * np.eye(6))))

    def cost(self, views: Sequence[int]) -> float:
        """The criterion, mm."""
        return float(np.exp(np.mean(np.log(self.surface_sd(views)))))

    def pairs(self, progress: Progress | None = None) -> Float:
        """The criterion ``(m, m)`` of all pairs of views, mm; the diagonal is that of one view twice."""
        m = len(self)
        out = np.zeros((m, m))
        for i in range(m):
            if progress is not None:
                progress("pairs of views", i, m)
            for j in range(i, m):
                out[i, j] = out[j, i] = self.cost((i, j))
        return out

    def conflicts(self, views: Sequence[int]) -> int:
        """How many pairs of a set are nearer than the settings' share of the even step."""
        limit = self.candidates.settings.spread * 180 / len(views)
        between = self.between[np.ix_(views, views)]
        return int((between[np.triu_indices(len(views), 1)] < limit - 1e-6).sum())

    def rank(self, views: Sequence[int]) -> tuple[int, float]:
        """Sorts sets of views, the best first: conflicts, then the criterion."""
        return self.conflicts(views), self.cost(views)

    def best_pair(self, pairs: Float) -> tuple[int, int]:
        """The pair of lowest rank, of all."""
        m = len(self)
        return min(((i, j) for i in range(m) for j in range(i + 1, m)), key=lambda p: (self.conflicts(p), pairs[p]))

    def improve(self, views: Sequence[int]) -> tuple[int, ...]:
        """Exchange single views for others as long as that lowers the rank."""
        chosen = tuple(views)
        best = self.rank(chosen)
        for _ in range(MAX_EXCHANGE_PASSES):
            before = best
            for place in range(len(chosen)):
                for view in range(len(self)):
                    trial = (*chosen[:place], view, *chosen[place + 1 :])
                    if view in chosen or self.conflicts(trial) > best[0]:
                        continue
                    rank = self.rank(trial)
                    if rank[0] < best[0] or rank[1] < best[1] * (1 - 1e-9):
                        chosen, best = trial, rank
            if best == before:
                break
        return tuple(sorted(chosen))

    def extend(self, views: Sequence[int]) -> tuple[int, ...]:
        """The best set of one view more than the given one."""
        count, angles = len(views) + 1, self.candidates.geometry.azimuths_deg
        more = [(*views, v) for v in range(len(self)) if v not in views]
        even = [s for first in range(len(self)) if (s := even_set(angles, count, first)) is not None]
        starts = [min(sets, key=self.rank) for sets in (more, even) if sets]
        return min((self.improve(s) for s in starts), key=self.rank)
