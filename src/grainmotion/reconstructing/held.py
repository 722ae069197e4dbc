"""Held: an image under way in this process, on the processor or on an NVIDIA card."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from grainmotion.device import chosen
from grainmotion.reconstructing.card import CardEquations
from grainmotion.reconstructing.equations import Equations, Views
from grainmotion.reconstructing.settings import ReconstructSettings
from grainmotion.scan import Scan
from grainmotion.volume import Volume


@dataclass(eq=False)
class Held:
    """An image (`equations.Iterate`), laid as its equations lay it, with the scan that it is to agree with."""

    equations: Equations | CardEquations
    image: Any
    before: Any = None

    @classmethod
    def of(cls, scan: Scan, grid: Volume, settings: ReconstructSettings) -> Held:
        """From the grid's own values."""
        on_card = chosen(settings.device).name == "cuda"
        equations = CardEquations(scan, grid, settings) if on_card else Equations(scan, grid, settings)
        return cls(equations, equations.start())

    def start_from(self, array: Any) -> None:
        """Go on from other values ``[z, y, x]``, as far as they are allowed."""
        self.image = self.equations.operator.laid(array)
        self.constrain()

    def add_update(self, views: Views, relaxation: float) -> Any:
        """See `Iterate`."""
        return self.equations.add_update(self.image, views, relaxation)

    def constrain(self) -> None:
        """See `Iterate`."""
        self.equations.constrain(self.image)

    def constrain_and_extrapolate(self, momentum: float) -> None:
        """See `Iterate`."""
        if self.before is None:
            raise ValueError("no image of the time before: set `before`")
        self.equations.constrain_and_extrapolate(self.image, self.before, momentum)

    def volume(self) -> Volume:
        """See `Iterate`."""
        return self.equations.volume(self.image if self.before is None else self.before)
