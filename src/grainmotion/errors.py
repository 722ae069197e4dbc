"""Exceptions. A message states the fact, then the remedy, and names the file, key or grain."""

from __future__ import annotations

LOG_NOTE = "log: "
"""Beginning of the note on an exception that names the log file of its run."""


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
    """

    def __init__(self, where: str, fact: str, remedy: str) -> None:
        self.where, self.fact, self.remedy = where, fact, remedy
        super().__init__(f"{where}: {fact}; {remedy}")

    def __reduce__(self) -> tuple[type[GrainmotionError], tuple[str, str, str]]:
        """Keep all three parts when an error is sent from one process to another."""
        return type(self), (self.where, self.fact, self.remedy)


class InputError(GrainmotionError, ValueError):
    """Something that the user gave cannot be used."""


class WriteError(InputError):
    """A file cannot be written: a full disk, no permission, a drive that is away."""


class InputWarning(UserWarning):
    """Something that the user gave is likely to be wrong."""


class BackendError(GrainmotionError, RuntimeError):
    """A device that was asked for cannot be used."""
