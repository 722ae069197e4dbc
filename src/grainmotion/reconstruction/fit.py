"""A volume fitted to a scan: what `reconstruct` does, without a look at the scan itself."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from grainmotion._typing import Progress
from grainmotion.model.scan import Scan
from grainmotion.model.summary import Summarised, Summary, shape_text
from grainmotion.model.thumbnails import grey_picture
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.coarse_start import started
from grainmotion.reconstruction.grid_growth import FittedGrid, fitted_grid, growth_views
from grainmotion.reconstruction.iterate import new_iterate
from grainmotion.reconstruction.ordered_subsets import accelerated, plain_sart
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import Iterate


@dataclass(frozen=True, repr=False, config={"arbitrary_types_allowed": True})
class Reconstruction(Summarised):
    """A reconstructed volume and its residuals.

    Attributes
    ----------
    volume : Volume
        Attenuation, 1/mm.
    residuals : tuple of float
        Relative residual ε = ‖b − A x‖/‖b‖ (Eq. 23) of each sweep or phase, each view just before its update.
    notes : tuple of str
        Sentences on the grid, if it was grown.

    Examples
    --------
    >>> views = case.scanner.geometry((0, 30, 60, 90, 120, 150))
    >>> scan = gm.Scan(gm.project(volume, views), views)
    >>> result = gm.reconstruct(scan, case.scanner.grid, gm.ReconstructSettings(sweeps=2))
    >>> len(result.residuals), result.residuals[-1] < result.residuals[0]
    (2, True)
    """

    volume: Volume
    residuals: tuple[float, ...]
    notes: tuple[str, ...] = ()

    def _summary(self) -> Summary:
        rows = [("volume", f"{shape_text(self.volume.shape)} voxels of {self.volume.voxel_size:.5g} mm")]
        rows += [("residual", f"{self.residuals[-1]:.3g} after {len(self.residuals)} sweeps")] if self.residuals else []
        rows += [("note", note) for note in self.notes]
        slice_ = grey_picture(self.volume.array[self.volume.shape[0] // 2], upwards=True)
        return Summary("Reconstruction", ", ".join(value for _, value in rows[:2]), tuple(rows), slice_)


def fitted_volume(
    scan: Scan, grid: Volume, settings: ReconstructSettings, progress: Progress | None = None
) -> Reconstruction:
    """As `reconstruct`, for trials: it looks neither for views that are shifted nor for beam hardening."""
    place = fitted_grid(scan.select(growth_views(len(scan))), scan.geometry, grid, settings)
    return on_grid(scan, place, progress)


def on_grid(scan: Scan, place: FittedGrid, progress: Progress | None = None) -> Reconstruction:
    """The volume of a scan on a grid that was made for it."""
    place.report(progress)
    grid, settings = place.grid, place.settings
    if settings.plain(len(scan)):
        iterate: Iterate = new_iterate(scan, grid, settings)
        history = plain_sart(iterate, len(scan), settings, progress)
    else:
        iterate = started(scan, grid, settings)
        history = accelerated(iterate, len(scan), progress)
    return Reconstruction(place.seen(iterate.into_volume()), tuple(history), place.notes)
