"""Simulated annealing of grains over candidate poses: Gibbs sampling against the residual radiographs.

A candidate is one of K turns and one of T shifts.  Of each turn the grain's (filtered) line integrals are
known at shift zero, as a patch in each view; a shift moves the patches along the panels, which is exact in a
parallel beam and near enough over a grain's size in a cone.  With the grain itself taken out of the residual
images R, a candidate lowers ‖R‖² by

    score = Σ_views  2 R·P − ‖P‖²,

where R·P for all shifts is one cross-correlation.  A visit draws a candidate with probability ∝ exp(score / τ).

``places (n, views)`` are patch numbers, −1 where a grain is out of sight.  Patch p has its first pixel at
``anchors[p]`` of the images and ``sizes[p]`` pixels, in ``tables[k, offsets[p]:]`` for turn k.  ``slopes (n,
views, 2, 3)`` are pixels (row, column) per unit of shift.

A chain of draws forgets nothing: one draw that falls otherwise leads elsewhere.  So that none is decided by how a
processor rounds, images and tables hold **whole numbers** (of a quantum that the caller chooses), whose products and
sums are exact in double precision in any order, and the arithmetic beside them is the plain one, without reordering.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

LOWEST = -1e300
GRID = 1024.0
"""Steps a unit to which the random part of a score is rounded: mathematics libraries differ in the last digits."""


@nb.njit(cache=CACHE, error_model="numpy")
def _add(image, patch, row, column, sign):
    """Add ``sign`` times a patch whose first pixel lies at a fractional (row, column), bilinearly, in whole numbers."""
    r0, c0 = int(np.floor(row)), int(np.floor(column))
    below, right = row - r0, column - c0
    rows, columns = patch.shape
    line = np.zeros(columns + 2)
    for r in range(rows + (1 if below > 0 else 0)):
        for c in range(columns):
            line[c + 1] = (1 - below) * patch[r, c] if r < rows else 0.0
        if r > 0 and below > 0:
            for c in range(columns):
                line[c + 1] += below * patch[r - 1, c]
        target = image[r0 + r]
        for c in range(columns + (1 if right > 0 else 0)):
            target[c0 + c] += sign * np.rint((1 - right) * line[c + 1] + right * line[c])


@nb.njit(cache=CACHE, error_model="numpy")
def _put(images, tables, places, anchors, sizes, offsets, slopes, g, turn, shift, sign):
    """Add ``sign`` times grain g at a candidate to the images."""
    for v in range(len(images)):
        p = places[g, v]
        if p < 0:
            continue
        rows, columns = sizes[p, 0], sizes[p, 1]
        patch = tables[turn, offsets[p] : offsets[p] + rows * columns].reshape(rows, columns)
        down = slopes[g, v, 0, 0] * shift[0] + slopes[g, v, 0, 1] * shift[1] + slopes[g, v, 0, 2] * shift[2]
        right = slopes[g, v, 1, 0] * shift[0] + slopes[g, v, 1, 1] * shift[1] + slopes[g, v, 1, 2] * shift[2]
        _add(images[v], patch, anchors[p, 0] + down, anchors[p, 1] + right, sign)


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def _correlate(images, tables, energies, places, anchors, sizes, offsets, g, reach, some, out):
    """2 R·P − ‖P‖² of some turns in each view at all whole-pixel moves, ``out (views, turns, moves)``.

    The image under each move is a column, so that the correlation is one matrix product a view.
    """
    down, right = 2 * reach[0] + 1, 2 * reach[1] + 1
    for v in nb.prange(len(images)):
        p = places[g, v]
        if p < 0:
            out[v] = 0
            continue
        rows, columns = sizes[p, 0], sizes[p, 1]
        patches = np.empty((len(some), rows * columns))
        for m in range(len(some)):
            patches[m] = tables[some[m], offsets[p] : offsets[p] + rows * columns]
        under = np.empty((rows * columns, down * right))
        for r in range(rows):
            for c in range(columns):
                for i in range(down):
                    line = images[v, anchors[p, 0] - reach[0] + r + i]
                    start = anchors[p, 1] - reach[1] + c
                    under[r * columns + c, i * right : (i + 1) * right] = line[start : start + right]
        found = np.dot(patches, under)
        for m in range(len(some)):
            for s in range(down * right):
                out[v, m, s] = 2 * found[m, s] - energies[some[m], p]


@nb.njit(cache=CACHE, error_model="numpy")
def _draw(rng, scores, slopes, shifts, some, g, reach, heat):
    """A row of scores and a shift of ``some``: the best at heat 0, else drawn with probability ∝ exp(score / heat)."""
    right = 2 * reach[1] + 1
    bounds = np.zeros(scores.shape[1])  # the most that a turn can score
    for v in range(len(scores)):
        for k in range(len(bounds)):
            bounds[k] += scores[v, k].max()
    best, top = LOWEST, LOWEST
    turn, row = 0, some[0]
    for k in np.argsort(-bounds):
        if bounds[k] < top - 12 * heat:  # nor will those that follow come near
            break
        for t in some:
            score = 0.0
            for v in range(len(scores)):
                s, m = shifts[t], slopes[g, v]
                down = m[0, 0] * s[0] + m[0, 1] * s[1] + m[0, 2] * s[2] + reach[0]
                over = m[1, 0] * s[0] + m[1, 1] * s[1] + m[1, 2] * s[2] + reach[1]
                i, j = min(int(down), max(2 * reach[0] - 1, 0)), min(int(over), 2 * reach[1] - 1)
                a, b = down - i, over - j
                near = scores[v, k, i * right + j : i * right + j + 2]
                value = near[0] + b * (near[1] - near[0])
                if a > 0:
                    far = scores[v, k, (i + 1) * right + j : (i + 1) * right + j + 2]
                    value += a * (far[0] + b * (far[1] - far[0]) - value)
                score += value
            top = max(top, score)
            if heat > 0:
                score -= heat * np.rint(GRID * math.log(-math.log(max(rng.random(), 1e-300)))) / GRID
            if score > best:
                best, turn, row = score, k, t
    return turn, row


@nb.njit(cache=CACHE, error_model="numpy")
def _choose(rng, deck, count, present):
    """``count`` numbers of a deck (all different, shuffled in place) at random, the present one among them."""
    for i in range(count):
        j = i + rng.integers(0, len(deck) - i)
        deck[i], deck[j] = deck[j], deck[i]
    some = deck[:count].copy()
    if not (some == present).any():
        some[0] = present
    return some


@nb.njit(cache=CACHE, error_model="numpy")
def anneal(rng, heats, batch, images, tables, energies, places, anchors, sizes, offsets, slopes, shifts, reach,
           turns, moves):  # fmt: skip
    """One sweep over all grains a heat, in random order, from and to ``turns (n,)`` and ``moves (n,)`` (rows).

    A visit weighs at most ``batch`` (turns, shifts) drawn at random.  ``images`` are the residual at the start;
    returned is the lowest ‖R‖², whose candidates are left behind.
    """
    n = len(turns)
    count = min(batch[0], len(tables)), min(batch[1], len(shifts))
    turn_deck, shift_deck = np.arange(len(tables)), np.arange(len(shifts))
    scores = np.empty((len(images), count[0], (2 * reach[0] + 1) * (2 * reach[1] + 1)))
    best, best_turns, best_moves = np.inf, turns.copy(), moves.copy()
    for heat in heats:
        for g in rng.permutation(n):
            some = _choose(rng, turn_deck, count[0], turns[g])
            moved = _choose(rng, shift_deck, count[1], moves[g])
            _put(images, tables, places, anchors, sizes, offsets, slopes, g, turns[g], shifts[moves[g]], 1.0)
            _correlate(images, tables, energies, places, anchors, sizes, offsets, g, reach, some, scores)
            row, moves[g] = _draw(rng, scores, slopes, shifts, moved, g, reach, heat)
            turns[g] = some[row]
            _put(images, tables, places, anchors, sizes, offsets, slopes, g, turns[g], shifts[moves[g]], -1.0)
        cost = 0.0
        for v in range(len(images)):
            for r in range(images.shape[1]):
                for c in range(images.shape[2]):
                    cost += images[v, r, c] ** 2
        if cost < best:
            best, best_turns[:], best_moves[:] = cost, turns, moves
    turns[:], moves[:] = best_turns, best_moves
    return best
