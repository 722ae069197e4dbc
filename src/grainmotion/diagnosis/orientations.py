"""Orders and directions of the axes of a stack: what another program may have written instead of z y x."""

from __future__ import annotations

from itertools import permutations, product

from numpy.typing import NDArray

Orientation = tuple[tuple[int, int, int], tuple[bool, bool, bool]]
"""Order of the axes, and which are reversed after that."""

AS_GIVEN: Orientation = ((0, 1, 2), (False, False, False))
ORIENTATIONS: tuple[Orientation, ...] = tuple(
    sorted(
        (((a, b, c), (i, j, k)) for a, b, c in permutations((0, 1, 2)) for i, j, k in product((False, True), repeat=3)),
        key=lambda orientation: (orientation[0] != AS_GIVEN[0], orientation),
    )
)
"""All 48; the first is that of the arrays as they are."""
FLIP_NAMES = {
    "z": "upside down",
    "y": "mirrored along y",
    "x": "mirrored along x",
    "yx": "turned by 180 degrees about z",
}
TURN_NAMES = {
    ((0, 2, 1), (False, True, False)): "turned by 90 degrees about z",
    ((0, 2, 1), (False, False, True)): "turned by -90 degrees about z",
}


def oriented(array: NDArray, orientation: Orientation) -> NDArray:
    """An array with its axes in another order and direction, a view of it."""
    order, reverse = orientation
    return array.transpose(order)[tuple(slice(None, None, -1 if r else 1) for r in reverse)]


def orientation_name(orientation: Orientation) -> str:
    """What is wrong with an array that this orientation would put right."""
    order, reverse = orientation
    if orientation in TURN_NAMES:
        return TURN_NAMES[orientation]
    axes = "zyx"
    reversed_axes = [axes[k] for k in range(3) if reverse[k]]
    flips = "".join(reversed_axes)
    flip = FLIP_NAMES.get(flips, f"reversed along {', '.join(reversed_axes)}" if flips else "")
    if order == AS_GIVEN[0]:
        return flip
    given = "".join(axes[order.index(k)] for k in range(3))
    return f"in the order {' '.join(given)} of axes instead of z y x" + (f", and {flip}" if flips else "")


def orientation_code(name: str, orientation: Orientation) -> str:
    """The array put right, as a numpy expression."""
    order, reverse = orientation
    text = name if order == AS_GIVEN[0] else f"{name}.transpose{order}"
    if any(reverse):
        text += f"[{', '.join('::-1' if r else ':' for r in reverse)}]"
    return text
