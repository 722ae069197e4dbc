"""One scan of an experiment: its files, and how its pixels become line integrals."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from grainmotion._typing import Float, Index, Kind, Pixels
from grainmotion.diagnosis import hypotheses
from grainmotion.diagnosis.frames import frame_findings
from grainmotion.diagnosis.grey_values import TO_UNSCALE, grey_value_findings, scaled, wrong_kind
from grainmotion.diagnosis.read_scan import ReadScan
from grainmotion.errors import InputError
from grainmotion.experiment.scan_tables import Air, Circular
from grainmotion.io.stacks import Stack
from grainmotion.model.finding import Finding, Level
from grainmotion.model.geometry import Geometry
from grainmotion.model.progress import detail
from grainmotion.model.scan import Scan, air_levels
from grainmotion.preprocessing.beam_hardening import Hardening
from grainmotion.preprocessing.flat_field import (
    checked_line_integrals,
    line_integrals_from_counts,
    line_integrals_from_transmission,
)
from grainmotion.preprocessing.masked_pixels import PixelReport
from grainmotion.preprocessing.outliers import PanelFacts, panel_facts, sample_views

_PANELS: dict[tuple[object, ...], PanelFacts] = {}  # of the scan of which views were read last


@dataclass(frozen=True, eq=False)
class ScanInput:
    """The files of one scan, located and checked, and how to read them."""

    key: str  # "reference" or "states.NAME"
    radiographs: Stack
    flats: Stack | None
    darks: Stack | None
    kind: Kind
    geometry: Geometry  # of the chosen views
    views: Index | None = None  # which radiographs to use; None for all
    air: Air | None = None  # where the radiographs show only air
    white_level: float | None = None  # count of the open beam, if there are no flats as the counts are divided by them
    saturation: float | None = None  # count from which a pixel is saturated
    monitor: Float | None = None  # −ln of the recorded beam over that of the flats, in each of the views
    levels: Float | None = None  # of the beam in each of the views, to be subtracted; not part of the `settings`
    hardening: Hardening | None = None  # curve that undoes beam hardening; not part of the `settings`
    sample: Index | None = None  # radiographs by which the panel is judged; None for some of those in use
    findings: tuple[Finding, ...] = ()  # about names of files, told angles, and what the scanner's file records
    circle: Circular | None = None  # numbers of a circular scan, if the geometry follows from them
    facts: tuple[tuple[str, str], ...] = ()  # what else the scanner's file tells, label and text

    @property
    def files(self) -> tuple[Path, ...]:
        """All image files."""
        stacks = (self.radiographs, self.flats, self.darks)
        return tuple(f for s in stacks if s is not None for f in s.files)

    @property
    def settings(self) -> dict[str, object]:
        """Whatever the line integrals depend on beside the content of the files, as plain data."""
        return {
            "kind": self.kind,
            "beam": self.geometry.beam,
            "geometry": self.geometry.vectors.tolist(),
            "views": None if self.views is None else self.views.tolist(),
            "air": None if self.air is None else asdict(self.air),
            "saturation": self.saturation,
            "white_level": self.white_level,
            "inner": [[p.inner, p.key] for s in (self.radiographs, self.flats, self.darks) if s for p in s.parts],
        }

    def select(self, views: Index) -> ScanInput:
        """The scan of some of its views: indices into the views that it has, in any order.

        Their pixels are masked as in the whole scan.
        """
        chosen = views if self.views is None else self.views[views]
        sample = self.sample
        if sample is None:
            sample = sample_views(len(self.geometry))
            sample = sample if self.views is None else self.views[sample]
        monitor, levels = (None if a is None else a[views] for a in (self.monitor, self.levels))
        scan = replace(self, views=chosen, geometry=self.geometry[views], sample=sample)
        return replace(scan, monitor=monitor, levels=levels)

    def fixed(self, fix: str) -> ScanInput:
        """The scan with a geometry in which one more mistake is undone, or several: "one, another"."""
        return replace(self, geometry=hypotheses.corrected(self.geometry, fix.split(", ")))

    def read(self) -> tuple[Scan, PixelReport]:
        """Read the radiographs as line integrals; errors name the files and the key."""
        read = self.read_with_raw()
        return read.scan, read.pixels

    def read_checked(self) -> tuple[Scan, PixelReport, tuple[Finding, ...]]:
        """The same, with what the checks of frames and grey values found."""
        read = self.read_with_raw()
        detail("checks of frames and grey values", 2, 3)
        frames, values = frame_findings(read), grey_value_findings(read)
        if any(
            f.level is Level.ERROR for f in values
        ):  # values of another kind are masked, which is no fault of pixels
            frames = tuple(f for f in frames if f.check != "pixels")
        return read.scan, read.pixels, (*values, *frames)

    def read_with_raw(self) -> ReadScan:
        """The same, with the images as they are in the files."""
        detail("files", 0, 3)
        images = self.radiographs.read(self.views)
        detail("pixels", 1, 3)
        flats = darks = None
        if self.kind == "counts":
            flats = self._white(images) if self.flats is None else self.flats.read()
            darks = None if self.darks is None else self.darks.read()
        try:
            panel = panel_facts(images, flats) if self.sample is None else self._panel(flats)
            scan, pixels = self._line_integrals(images, flats, darks, panel)
            for levels in (self.monitor, self.levels):
                _subtract(scan, levels)
            if self.air is not None:
                _subtract(scan, air_levels(scan, margin=self.air.margin, region=self.air.region))
        except InputError as error:
            wrong = wrong_kind(self.kind, images, flats)
            fact, remedy = error.fact, error.remedy
            if wrong is not None:
                fact = f'the values look like {wrong[0]}, but are told as kind "{self.kind}" ({wrong[1]})'
                remedy = f'set {self.key}.kind = "{wrong[0]}"'
                if wrong[0] == "counts":
                    remedy += " and give flats and darks; if they are transmissions times a factor, divide them by it"
            elif scaled(self.kind, images, flats):
                fact, remedy = scaled(self.kind, images, flats), TO_UNSCALE
            raise InputError(self._named(error.where), fact, remedy) from error
        scan = scan if self.hardening is None else self.hardening.apply(scan)
        names = {name: self._named(name) for name in ("radiographs", "flats", "darks")}
        top = panel.top if self.saturation is None else None
        return ReadScan(self.key, names, self.kind, images, flats, darks, scan, pixels, top)

    def _white(self, images: Pixels) -> Pixels | None:
        """One flat of the white level, if there are no flats."""
        return None if self.white_level is None else np.full((1, *images.shape[1:]), self.white_level, np.float32)

    def _line_integrals(
        self, images: Pixels, flats: Pixels | None, darks: Pixels | None, panel: PanelFacts
    ) -> tuple[Scan, PixelReport]:
        if self.kind == "counts":
            assert flats is not None  # find_scan refuses counts without flats
            return line_integrals_from_counts(
                images, flats, darks, self.geometry, saturation=self.saturation, panel=panel
            )
        convert = line_integrals_from_transmission if self.kind == "transmission" else checked_line_integrals
        return convert(images, self.geometry, panel=panel)

    def _panel(self, flats: Pixels | None) -> PanelFacts:
        """The panel as the whole scan shows it, found once a process."""
        assert self.sample is not None
        status = [path.stat() for path in self.files]
        files = tuple((str(path), s.st_mtime_ns, s.st_size) for path, s in zip(self.files, status, strict=True))
        key = files, tuple(map(int, self.sample)), self.kind
        if key not in _PANELS:
            _PANELS.clear()
            _PANELS[key] = panel_facts(self.radiographs.read(self.sample), flats)
        return _PANELS[key]

    def _named(self, where: str) -> str:
        """File and key for the "counts", "flats" or "darks" that an error names."""
        stack = {"flats": self.flats, "darks": self.darks}.get(where, self.radiographs)
        key = where if where in ("flats", "darks") or where.startswith("air") else "radiographs"
        return f"{stack.spec if stack else ''} ({self.key}.{key})"


def _subtract(scan: Scan, levels: Float | None) -> None:
    """As `Scan.levelled`, in the arrays of a scan that was just read and nobody else has: a copy may not fit."""
    if levels is not None:
        for image, level in zip(scan.line_integrals, levels.astype(scan.line_integrals.dtype), strict=True):
            image -= level
