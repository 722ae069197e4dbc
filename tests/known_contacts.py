"""Contacts with given normals, for tests of fabric."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainmotion.mechanics.contacts import Contacts


def contacts_along(normals: np.ndarray, pairs: list[list[int]] | None = None, count: int = 2, **changes) -> Contacts:
    """Contacts with these normals between grains 1 … count."""
    m = len(normals)
    pairs = np.array([[1, 2]] * m if pairs is None else pairs).reshape(m, 2)
    normals = np.asarray(normals, dtype=float).reshape(m, 3)
    known = Contacts(
        pairs, np.zeros(m), np.zeros(m), np.full(m, "contact", dtype="<U13"), np.zeros((m, 3)), normals, 2 * normals,
        np.arange(1, count + 1), np.zeros(count, dtype=bool), (), 0.5, 1.0,
    )  # fmt: skip
    return replace(known, **changes)
