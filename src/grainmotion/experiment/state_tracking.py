"""Errors of tracking, with the names of the experiment file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from grainmotion.errors import InputError


@contextmanager
def errors_of_state(key: str, initial: str) -> Iterator[None]:
    """Name the state, by its key, and the value of its key ``initial`` in errors of tracking."""
    try:
        yield
    except InputError as error:
        where = f"initial ({initial})" if error.where == "initial" else error.where
        raise InputError(f"{key}.{where}", error.fact, error.remedy) from error
