"""Reconstruction of a volume from a scan, with the projector that tracking uses as well, as the paper requires."""

from __future__ import annotations

from pydantic.dataclasses import dataclass

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.coarse_start import started
from grainmotion.reconstruction.grid_growth import fitted_grid, growth_views
from grainmotion.reconstruction.iterate import new_iterate
from grainmotion.reconstruction.ordered_subsets import accelerated, plain_sart
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.system import Iterate

__all__ = ["ReconstructSettings", "Reconstruction", "reconstruct"]


@dataclass(frozen=True, config={"arbitrary_types_allowed": True})
class Reconstruction:
    """A reconstructed volume and its residuals.

    Attributes
    ----------
    volume : Volume
        Attenuation, 1/mm.
    residuals : tuple of float
        Relative residual ε = ‖b − A x‖/‖b‖ (Eq. 23) of each sweep or phase, each view just before its update.
    notes : tuple of str
        Sentences on the grid, if it was grown.
    """

    volume: Volume
    residuals: tuple[float, ...]
    notes: tuple[str, ...] = ()


@checked_arguments
def reconstruct(
    scan: Scan, grid: Volume, settings: ReconstructSettings | None = None, *, progress: Progress | None = None
) -> Reconstruction:
    """Reconstruct a scan.

    The grid is grown where rays that show the sample leave it, see ``settings.outline``: the sample goes on above or
    below the panel, or beside it (local tomography).

    Parameters
    ----------
    scan : Scan
        Line integrals of the full scan.
    grid : Volume
        Where to reconstruct; its values are the initial volume (usually zeros).
    settings : ReconstructSettings, optional
        Projector, method, and the stopping rule of plain SART.
    progress : callable, optional
        Called as ``progress(message, done, total)`` after each update, in views; the message carries ε.

    Returns
    -------
    Reconstruction
        The volume on ``grid``, or on a larger grid that has the same voxels, with what of it the scan saw
        (`Volume.field`), and ε after each sweep (plain SART) or phase (accelerated).
    """
    settings = settings or ReconstructSettings()
    fitted = fitted_grid(scan.select(growth_views(len(scan))), scan.geometry, grid, settings)
    fitted.report(progress)
    grid, settings = fitted.grid, fitted.settings
    if settings.plain(len(scan)):
        iterate: Iterate = new_iterate(scan, grid, settings)
        history = plain_sart(iterate, len(scan), settings, progress)
    else:
        iterate = started(scan, grid, settings)
        history = accelerated(iterate, len(scan), progress)
    return Reconstruction(fitted.seen(iterate.volume()), tuple(history), fitted.notes)
