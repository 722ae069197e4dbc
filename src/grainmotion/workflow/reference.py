"""The reference state made from its full scan, as the command ``grainmotion run`` makes it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import checked_arguments
from grainmotion._typing import Progress
from grainmotion.calibration.beam_level import beam_levels
from grainmotion.calibration.scanner import ScannerCalibration, calibrate_scanner
from grainmotion.calibration.settings import ReferenceSettings
from grainmotion.model.grains import GrainSet
from grainmotion.model.progress import prefixed
from grainmotion.model.scan import Scan
from grainmotion.model.summary import Summarised, Summary, names_text, shape_text
from grainmotion.model.thumbnails import grey_picture
from grainmotion.model.volume import Volume
from grainmotion.preprocessing.flat_field import refuse_counts
from grainmotion.reconstruction.reconstruct import reconstruct
from grainmotion.segmentation.border import cut_labels
from grainmotion.segmentation.extraction import extract_grains
from grainmotion.segmentation.segment import Segmentation, segment


@dataclass(frozen=True, eq=False, repr=False)
class Reference(Summarised):
    """The reference state: its volume, labels and grains, and the calibration of the scanner.

    Attributes
    ----------
    volume : Volume
        Attenuation, 1/mm.
    segmentation : Segmentation
        Labels, threshold, and the grains cut by the border of the field of view.
    grains : GrainSet
        The grains, for `track`.
    scanner : ScannerCalibration
        Corrections that hold for the later states too, see `correct`.
    residuals : tuple of float
        Relative residual of the reconstruction after each sweep.

    Examples
    --------
    >>> settings = gm.ReferenceSettings(calibrate=gm.ScannerSettings(geometry=False))
    >>> reference = gm.Reference.from_scan(case.reference(), case.scanner.grid, settings)
    >>> len(reference.grains)
    4
    >>> corrected = reference.correct(state)  # for gm.track(reference.grains, corrected)
    """

    volume: Volume
    segmentation: Segmentation
    grains: GrainSet
    scanner: ScannerCalibration
    residuals: tuple[float, ...]

    @classmethod
    @checked_arguments
    def from_scan(
        cls,
        scan: Scan,
        grid: Volume,
        settings: ReferenceSettings | None = None,
        *,
        labels: NDArray[np.integer] | None = None,
        progress: Progress | None = None,
    ) -> Reference:
        """Level the beam, calibrate the scanner, reconstruct, segment, extract the grains, as ``grainmotion run`` does.

        Parameters
        ----------
        scan : Scan
            Line integrals of the full scan of the reference state, with the geometry as given.
        grid : Volume
            Where to reconstruct, zeros as a rule, mm.
        settings : ReferenceSettings, optional
            What to calibrate, and how to reconstruct and segment; by default as an experiment file without these
            tables.  Those of an experiment file are ``read_experiment(path).reference_settings``.
        labels : (nz, ny, nx) integer array, optional
            Grains, 0 for none, instead of a segmentation.
        progress : callable, optional
            Called as ``progress(message, done, total)``.

        Returns
        -------
        Reference
            Its ``grains`` are for `track`; radiographs of later states go through `correct` first.

        Raises
        ------
        InputError
            If the scan has too few views for what is to be calibrated, or no grain is found.
        """
        refuse_counts(scan.line_integrals)
        settings = settings or ReferenceSettings()
        given = None if labels is None else labels.astype(np.int32)
        if settings.calibrate.beam_level == "auto":
            levels = beam_levels(scan, grid, settings.reconstruct)
            scan = scan if levels.source == "none" else scan.levelled(levels.levels)
        scanner = calibrate_scanner(scan, grid, settings, labels=given, progress=progress)
        step = prefixed(progress, "reconstruct")
        how = settings.reconstruct if given is None else replace(settings.reconstruct, outline="grid")
        if settings.calibrate.hardening:  # the scan is linearised by another curve
            how = replace(how, hardening=False)
        reconstruction = reconstruct(scanner.apply(scan), grid, how, progress=step)
        volume = reconstruction.volume
        if given is None:
            segmentation = segment(volume, settings.segment, progress=prefixed(progress, "segment"))
        else:
            segmentation = replace(Segmentation.of(given), border=cut_labels(given, volume))
        grains = extract_grains(volume, segmentation, settings.segment)
        return cls(volume, segmentation, grains, scanner, reconstruction.residuals)

    @checked_arguments
    def correct(self, scan: Scan) -> Scan:
        """Correct radiographs of a later state by the calibration of the scanner.

        Parameters
        ----------
        scan : Scan
            As measured, with the geometry as given.

        Returns
        -------
        Scan
            With the corrected geometry and linearised line integrals, for `track`.
        """
        return self.scanner.apply(scan)

    def _summary(self) -> Summary:
        volume, n = self.volume, len(self.grains)
        rows = [("volume", f"{shape_text(volume.shape)} voxels of {volume.voxel_size:.5g} mm"), ("grains", str(n))]
        rows += [("labels", names_text([str(label) for label in self.grains.labels]))]
        rows += [("residual", f"{self.residuals[-1]:.3g} after {len(self.residuals)} sweeps")] if self.residuals else []
        if self.scanner.calibration is not None:
            rows.append(("calibration", ", ".join(map(str, self.scanner.calibration.corrections)) or "none needed"))
        line = f"{n} grains in {rows[0][1]}"
        return Summary("Reference", line, tuple(rows), grey_picture(volume.array[volume.shape[0] // 2], upwards=True))
