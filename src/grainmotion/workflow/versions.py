"""Versions of Python and of the libraries that compute, for the log of a run and ``grainmotion version``."""

from __future__ import annotations

import platform
from importlib import metadata

LOGGED_PACKAGES = ("numpy", "scipy", "numba", "scikit-image", "edt", "tifffile", "imagecodecs", "h5py", "pydantic")


def package_versions() -> dict[str, str]:
    """The versions by name, Python's first; ``missing`` for what is not installed."""
    return {"Python": platform.python_version(), **{name: _version(name) for name in LOGGED_PACKAGES}}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "missing"
