"""Where compiled kernels are kept between runs, and what happens where nothing can be written.

Numba keeps compiled code beside the package or in the user's cache folder, and refuses to define a kernel that is to
be kept where neither can be written (a container, a service account).  Then a folder for temporary files serves, and
where there is none either, kernels are compiled anew in every run.
"""

from __future__ import annotations

import logging
import os
import stat
import tempfile

import numba as nb

_log = logging.getLogger(__name__)


def cache_available() -> bool:
    """Whether compiled kernels can be kept; moves the cache to a temporary folder if that is what it takes."""
    if _can_be_kept():
        return True
    config = vars(nb.config)
    given = config["CACHE_DIR"]
    tried = f"NUMBA_CACHE_DIR ({given}), " if given else ""
    what = f"compiled kernels cannot be kept: {tried}the package's folder and the home are not writable"
    folder = _temporary_folder()
    if folder is not None:
        config["CACHE_DIR"] = folder
        if _can_be_kept():
            os.environ["NUMBA_CACHE_DIR"] = folder  # for workers
            os.environ.setdefault("MPLCONFIGDIR", folder)  # Matplotlib would look for one, and warn in lines of its own
            _log.warning("%s; they go to %s (set NUMBA_CACHE_DIR to choose another folder)", what, folder)
            return True
        config["CACHE_DIR"] = given
    _log.warning("%s; every run compiles them anew (set NUMBA_CACHE_DIR to a folder that can be written)", what)
    return False


def _can_be_kept() -> bool:
    try:
        nb.njit(cache=True)(_nothing)
    except RuntimeError:  # no folder that can be written
        return False
    return True


def _nothing():
    """A kernel to try the cache with."""


def _temporary_folder() -> str | None:
    """A folder that this user alone can write: whoever writes there decides which code is run."""
    user = os.getuid() if hasattr(os, "getuid") else None
    try:
        folder = os.path.join(tempfile.gettempdir(), f"grainmotion-kernels-{user}")
        os.makedirs(folder, mode=0o700, exist_ok=True)
        found = os.lstat(folder)
    except OSError:
        return None
    own = user is None or (found.st_uid == user and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH))
    return folder if own and stat.S_ISDIR(found.st_mode) else None


CACHE = cache_available()
"""What kernels give numba as ``cache``."""
