"""Simulated annealing of grains over candidate poses: Gibbs sampling against the residual radiographs.

A candidate is one of K turns and one of T shifts.  Of each turn the grain's (filtered) line integrals are
known at shift zero, as a patch in each view; a shift moves the patches along the panels, which is exact in a
parallel beam and near enough over a grain's size in a cone.  With the grain itself taken out of the residual
images R, a candidate lowers ‖R‖² by

    score = Σ_views  2 R·P − ‖P‖²,

where R·P for all shifts is one cross-correlation.  A visit draws a candidate with probability ∝ exp(score / τ).

``places (n, views)`` are patch numbers, −1 where a grain is out of sight.  Patch p has its first pixel at
``anchors[p]`` of the images and ``sizes[p]`` pixels, in ``tables[k, offsets[p]:]`` for turn k, zero outside the
rows and columns ``extents[k, p]`` (first, end, first, end).  ``slopes (n, views, 2, 3)`` are pixels (row, column)
per unit of shift.
"""

from __future__ import annotations

import numba as nb
import numpy as np

LOWEST = -1e30  # fast arithmetic knows no infinity


@nb.njit(cache=True, fastmath=True, error_model="numpy")
def _add(image, patch, row, column, sign):
    """Add ``sign`` times a patch whose first pixel lies at a fractional (row, column), bilinearly."""
    r0, c0 = int(np.floor(row)), int(np.floor(column))
    below, right = row - r0, column - c0
    for r in range(patch.shape[0]):
        for k in range(2):
            weight = sign * (below if k else 1 - below)
            if weight == 0:
                continue
            target = image[r0 + r + k]
            for c in range(patch.shape[1]):
                target[c0 + c] += weight * (1 - right) * patch[r, c]
            if right > 0:
                for c in range(patch.shape[1]):
                    target[c0 + c + 1] += weight * right * patch[r, c]


@nb.njit(cache=True, error_model="numpy")
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


@nb.njit(parallel=True, cache=True, fastmath=True, error_model="numpy")
def _correlate(images, tables, energies, places, anchors, sizes, offsets, extents, g, reach, out, bounds):
    """2 R·P − ‖P‖² of every turn and view at all whole-pixel moves, and the most that a turn can score."""
    for k in nb.prange(len(tables)):
        bounds[k] = 0
        for v in range(len(images)):
            p = places[g, v]
            if p < 0:
                continue
            patch = tables[k, offsets[p] : offsets[p] + sizes[p, 0] * sizes[p, 1]].reshape(sizes[p, 0], sizes[p, 1])
            r0, r1, c0, c1 = extents[k, p]
            top = LOWEST
            for i in range(2 * reach[0] + 1):
                for j in range(2 * reach[1] + 1):
                    row, column = anchors[p, 0] + i - reach[0], anchors[p, 1] + j - reach[1]
                    total = np.float32(0)
                    for r in range(r0, r1):
                        line = images[v, row + r]
                        for c in range(c0, c1):
                            total += line[column + c] * patch[r, c]
                    out[k, v, i, j] = 2 * total - energies[k, p]
                    top = max(top, out[k, v, i, j])
            bounds[k] += top


@nb.njit(cache=True, fastmath=True, error_model="numpy")
def _draw(rng, scores, bounds, places, slopes, shifts, g, reach, heat):
    """A candidate (turn, row of shifts): the best at heat 0, else one drawn with probability ∝ exp(score / heat)."""
    best, top = LOWEST, LOWEST
    turn, row = 0, 0
    for k in np.argsort(-bounds):
        if bounds[k] < top - 12 * heat:  # nor will those that follow come near
            break
        for t in range(len(shifts)):
            score = 0.0
            for v in range(scores.shape[1]):
                if places[g, v] < 0:
                    continue
                s, m = shifts[t], slopes[g, v]
                down = m[0, 0] * s[0] + m[0, 1] * s[1] + m[0, 2] * s[2] + reach[0]
                right = m[1, 0] * s[0] + m[1, 1] * s[1] + m[1, 2] * s[2] + reach[1]
                i, j = min(int(down), max(2 * reach[0] - 1, 0)), min(int(right), max(2 * reach[1] - 1, 0))
                a, b = down - i, right - j
                image = scores[k, v]
                near = image[i, j] + b * (image[i, j + 1] - image[i, j])
                if a > 0:
                    far = image[i + 1, j] + b * (image[i + 1, j + 1] - image[i + 1, j])
                    near += a * (far - near)
                score += near
            top = max(top, score)
            if heat > 0:
                score -= heat * np.log(-np.log(max(rng.random(), 1e-300)))
            if score > best:
                best, turn, row = score, k, t
    return turn, row


@nb.njit(cache=True, error_model="numpy")
def anneal(rng, heats, images, tables, energies, places, anchors, sizes, offsets, extents, slopes, shifts, reach,
           turns, moves):  # fmt: skip
    """One sweep over all grains a heat, in random order, from and to ``turns (n,)`` and ``moves (n,)`` (rows).

    ``images`` are the residual at the start; returned is the lowest ‖R‖², whose candidates are left behind.
    """
    n = len(turns)
    scores = np.empty((len(tables), len(images), 2 * reach[0] + 1, 2 * reach[1] + 1), np.float32)
    bounds = np.empty(len(tables))
    best, best_turns, best_moves = np.inf, turns.copy(), moves.copy()
    for heat in heats:
        for g in rng.permutation(n):
            _put(images, tables, places, anchors, sizes, offsets, slopes, g, turns[g], shifts[moves[g]], 1.0)
            _correlate(images, tables, energies, places, anchors, sizes, offsets, extents, g, reach, scores, bounds)
            turns[g], moves[g] = _draw(rng, scores, bounds, places, slopes, shifts, g, reach, heat)
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
