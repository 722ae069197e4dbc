"""One update after the other, whoever makes them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from grainmotion.reconstructing.equations import Iterate, Views


def updated(
    iterate: Iterate, parts: Iterable[tuple[Views, float]], momentum: float, tell: Callable[[Any, int], None]
) -> Any:
    """Update an image by some views after others, each with its relaxation; Σ(b − A x)² and Σb² of all, ``(2,)``.

    ``tell(squares so far, views so far)`` is called for each update in turn, some behind (`Iterate.ahead`).
    """
    squares: Any = np.zeros(2)
    done, under_way = 0, deque[tuple[Any, int]]()

    def settle(most: int) -> None:
        nonlocal squares, done
        while len(under_way) > most:
            found, count = under_way.popleft()
            squares = squares + found
            done += count
            tell(squares, done)

    for views, relaxation in parts:
        under_way.append((iterate.update(views, relaxation, momentum), len(views)))
        settle(iterate.ahead)
    settle(0)
    return squares
