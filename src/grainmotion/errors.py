"""Exceptions. A message states the fact, then the remedy, and names the file, key or grain."""

from __future__ import annotations

LOG_NOTE = "log: "
"""Beginning of the note on an exception that names the log file of its run."""
ALSO = "\n  also "
"""Between the errors of a message that tells several, each on its own line."""


class GrainmotionError(Exception):
    """Base of every error that grainmotion raises on purpose.

    Parameters
    ----------
    where : str
        File, key, view, grain or device at fault.
    fact : str
        What is wrong, echoing the value.
    remedy : str
        What to do about it.

    Examples
    --------
    >>> try:
    ...     gm.Volume.zeros((8, 8, 8), voxel_size=-1)
    ... except gm.GrainmotionError as error:
    ...     print(error.where, "|", error.fact, "|", error.remedy)
    volume.voxel_size | must be > 0, got -1 | give it in mm
    """

    def __init__(self, where: str, fact: str, remedy: str) -> None:
        self.where, self.fact, self.remedy = where, fact, remedy
        super().__init__(f"{where}: {fact}; {remedy}")

    def __reduce__(self) -> tuple[type[GrainmotionError], tuple[str, str, str]]:
        """Keep all three parts when an error is sent from one process to another."""
        return type(self), (self.where, self.fact, self.remedy)


class InputError(GrainmotionError, ValueError):
    """Something that the user gave cannot be used.

    Examples
    --------
    >>> try:
    ...     gm.Volume(np.zeros((3, 3)), voxel_size=0.1)
    ... except gm.InputError as error:
    ...     print(error)
    volume: shape (3, 3) is not (z, y, x); give a 3-D stack
    """


class WriteError(InputError):
    """A file cannot be written: a full disk, no permission, a drive that is away."""


class InputWarning(UserWarning):
    """Something that the user gave is likely to be wrong.

    Examples
    --------
    Make an error of everything that is doubtful:

    >>> import warnings
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", gm.InputWarning)
    ...     images = gm.simulate_radiographs(grains, motions, state.geometry)
    """


class BackendError(GrainmotionError, RuntimeError):
    """A device that was asked for cannot be used.

    Examples
    --------
    >>> try:
    ...     raise gm.BackendError("device", "no NVIDIA GPU was found", 'use device = "cpu"')
    ... except gm.GrainmotionError as error:
    ...     print(error.remedy)
    use device = "cpu"
    """
