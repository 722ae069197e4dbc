"""Exceptions. A message states the fact, then the remedy, and names the file, key or grain."""

from __future__ import annotations


class GrainmotionError(Exception):
    """Base of every error that grainmotion raises on purpose."""


class InputError(GrainmotionError):
    """Something that the user gave cannot be used.

    Parameters
    ----------
    where : str
        File, key, view or grain at fault.
    fact : str
        What is wrong, echoing the value.
    remedy : str
        What to do about it.
    """

    def __init__(self, where: str, fact: str, remedy: str) -> None:
        self.where, self.fact, self.remedy = where, fact, remedy
        super().__init__(f"{where}: {fact}; {remedy}")

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        """Travel whole from one process to another."""
        return type(self), (self.where, self.fact, self.remedy)
