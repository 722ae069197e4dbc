"""Errors of tracking in the words of the experiment file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from grainmotion.errors import InputError


@contextmanager
def errors_of_state(key: str, initial: str) -> Iterator[None]:
    """Name the state in errors; ``initial`` is what the experiment file says of where its tracking starts."""
    try:
        yield
    except InputError as error:
        where = error.where.replace("start", f"initial ({initial})")
        raise InputError(f"{key}.{where}", error.fact, error.remedy) from error
