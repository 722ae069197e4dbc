"""Words that arguments and options take."""

from __future__ import annotations

from enum import StrEnum


class CaseName(StrEnum):
    """A simulated packing."""

    SMALL = "small"
    PAPER = "paper"


class DatasetName(StrEnum):
    """What `simulate` writes: the packings, and the hard cases at the small one's size."""

    SMALL = "small"
    PAPER = "paper"
    NOISY = "noisy"
    BEAM_HARDENING = "beam-hardening"
    BLUR = "blur"
    MISALIGNED = "misaligned"
    MISALIGNED_STATE = "misaligned-state"
    GAIN_DRIFT = "gain-drift"
    GAIN_DRIFT_VIEWS = "gain-drift-views"
    CONTAINER = "container"
    MISSING = "missing"
    BROKEN = "broken"
    NEAR_SPHERICAL = "near-spherical"
    SHEAR_BAND = "shear-band"
    PLAIN = "plain"
    TALL = "tall"
    WIDE = "wide"
    PLATENS = "platens"
    WET = "wet"
    DRAINS = "drains"
    SIZES = "sizes"
    GONE = "gone"
    SOFT = "soft"
    SETTLING = "settling"
    MATERIALS = "materials"
    COMBINED = "combined"
    ROUND = "round"


class Format(StrEnum):
    """What `export FILE` writes."""

    VTK = "vtk"
    SPAM = "spam"
    TIFF = "tiff"
    OME_ZARR = "ome-zarr"
    DEM = "dem"
    MECHANICS = "mechanics"


class SpamPoint(StrEnum):
    """The point whose displacement a file for spam gives."""

    CENTROID = "centroid"
    BOX = "box"


class ColorWhen(StrEnum):
    """When output has colours."""

    AUTO = "auto"
    ALWAYS = "always"
    NEVER = "never"
