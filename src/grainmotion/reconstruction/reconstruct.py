"""Reconstruction of a volume from a scan, with the projector that tracking uses as well, as the paper requires."""

from __future__ import annotations

from dataclasses import replace

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.model.progress import detail
from grainmotion.model.scan import Scan
from grainmotion.model.volume import Volume
from grainmotion.reconstruction.fit import Reconstruction, on_grid
from grainmotion.reconstruction.grid_growth import fitted_grid, growth_views
from grainmotion.reconstruction.hardening import consistent_hardening
from grainmotion.reconstruction.settings import ReconstructSettings
from grainmotion.reconstruction.view_shifts import measured_shifts

__all__ = ["ReconstructSettings", "Reconstruction", "reconstruct"]


@checked_arguments
def reconstruct(
    scan: Scan, grid: Volume, settings: ReconstructSettings | None = None, *, progress: Progress | None = None
) -> Reconstruction:
    """Reconstruct a scan.

    The grid is grown where rays that show the sample leave it, see ``settings.outline``: the sample goes on above or
    below the panel, or beside it (local tomography).  The scan is linearised first if its views contradict each other
    by what beam hardening explains, see ``settings.hardening``.

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
        (`Volume.field`), how its views are shifted and the curve that linearised it
        (`Volume.hardening`), and ε after each sweep (plain SART) or phase (accelerated).

    Examples
    --------
    >>> scan = case.reference()  # 90 views
    >>> result = gm.reconstruct(scan, case.scanner.grid, gm.ReconstructSettings(sweeps=2))
    >>> result.volume.shape
    (96, 72, 72)
    """
    settings = settings or ReconstructSettings()
    detail("extent of the sample", 0, 8)
    place = fitted_grid(scan.select(growth_views(len(scan))), scan.geometry, grid, settings)
    detail("beam hardening", 1, 8)
    hardening = consistent_hardening(scan.select, scan.geometry, place.grid, place.settings)
    scan = hardening.apply(scan)
    detail("start on coarse voxels", 2, 8, 6)
    fitted = on_grid(scan, place, progress)
    volume = replace(fitted.volume, hardening=hardening)
    if volume.field is not None:
        detail("shifts of views")
        volume = replace(volume, field=replace(volume.field, shifts=measured_shifts(scan, volume)))
    return replace(fitted, volume=volume)
