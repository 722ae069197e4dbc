"""Kernels: simulated annealing of grains over candidate poses, by Gibbs sampling against the residual radiographs.

A candidate is one of K rotations and one of T shifts.  For each rotation the grain's (filtered) line integrals at zero
shift are stored as a patch in each view.  A shift moves the patches along the panels, which is exact in a parallel
beam and a good approximation over a grain's size in a cone beam.  With the grain itself removed from the residual
images R, a candidate lowers ‖R‖² by

    score = Σ_views  2 R·P − ‖P‖²,

where R·P for all shifts is one cross-correlation.  A visit draws a candidate with probability ∝ exp(score / τ), τ the
temperature.

``places (n, views)`` are patch numbers, −1 where a grain is out of view.  Patch p has its first pixel at ``anchors[p]``
of the images and ``sizes[p]`` pixels, in ``tables[k, offsets[p]:]`` for rotation k.  ``gradients (n, views, 2, 3)`` are
pixels (row, column) per unit of shift.

Each draw depends on all draws before it: one that differs by a rounding error changes the result.  Therefore images
and tables hold **whole numbers** (of a quantum that the caller chooses), whose products and sums are exact in double
precision in any order, and the other arithmetic is compiled without reordering.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from grainmotion.kernels.compilation import CACHE

LOWEST_SCORE = -1e300
SCORE_STEPS = 1024.0
"""The random part of a score is rounded to 1/SCORE_STEPS, since mathematics libraries differ in the last digits."""


@nb.njit(cache=CACHE, error_model="numpy")
def _add_patch(image, patch, row, column, sign):
    """Add ``sign`` times a patch, shifted bilinearly to a fractional (row, column) and rounded to whole numbers."""
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
def _add_grain(images, tables, places, anchors, sizes, offsets, gradients, g, rotation, shift, sign):
    """Add ``sign`` times grain g at a candidate to the images."""
    for v in range(len(images)):
        p = places[g, v]
        if p < 0:
            continue
        rows, columns = sizes[p, 0], sizes[p, 1]
        patch = tables[rotation, offsets[p] : offsets[p] + rows * columns].reshape(rows, columns)
        down = gradients[g, v, 0, 0] * shift[0] + gradients[g, v, 0, 1] * shift[1] + gradients[g, v, 0, 2] * shift[2]
        right = gradients[g, v, 1, 0] * shift[0] + gradients[g, v, 1, 1] * shift[1] + gradients[g, v, 1, 2] * shift[2]
        _add_patch(images[v], patch, anchors[p, 0] + down, anchors[p, 1] + right, sign)


@nb.njit(parallel=True, cache=CACHE, error_model="numpy")
def _correlate(images, tables, energies, places, anchors, sizes, offsets, g, margin, chosen, out):
    """2 R·P − ‖P‖² of the chosen rotations in each view at all whole-pixel moves, ``out (views, rotations, moves)``.

    Moves are up to ``margin`` pixels down and right, and back.  The image window under each move is a column, so that
    the correlation is one matrix product a view.
    """
    down, right = 2 * margin[0] + 1, 2 * margin[1] + 1
    for v in nb.prange(len(images)):
        p = places[g, v]
        if p < 0:
            out[v] = 0
            continue
        rows, columns = sizes[p, 0], sizes[p, 1]
        patches = np.empty((len(chosen), rows * columns))
        for m in range(len(chosen)):
            patches[m] = tables[chosen[m], offsets[p] : offsets[p] + rows * columns]
        windows = np.empty((rows * columns, down * right))
        for r in range(rows):
            for c in range(columns):
                for i in range(down):
                    line = images[v, anchors[p, 0] - margin[0] + r + i]
                    start = anchors[p, 1] - margin[1] + c
                    windows[r * columns + c, i * right : (i + 1) * right] = line[start : start + right]
        products = np.dot(patches, windows)
        for m in range(len(chosen)):
            for s in range(down * right):
                out[v, m, s] = 2 * products[m, s] - energies[chosen[m], p]


@nb.njit(cache=CACHE, error_model="numpy")
def _draw_candidate(rng, scores, gradients, shifts, chosen, g, margin, temperature):
    """A row of ``scores`` and one of the chosen shifts: the best at temperature 0, else drawn ∝ exp(score / τ)."""
    right = 2 * margin[1] + 1
    bounds = np.zeros(scores.shape[1])  # upper bound of each rotation's score
    for v in range(len(scores)):
        for k in range(len(bounds)):
            bounds[k] += scores[v, k].max()
    best, top = LOWEST_SCORE, LOWEST_SCORE
    rotation, number = 0, chosen[0]
    for k in np.argsort(-bounds):
        if bounds[k] < top - 12 * temperature:  # neither this rotation nor those after it are likely to be drawn
            break
        for t in chosen:
            score = 0.0
            for v in range(len(scores)):
                s, m = shifts[t], gradients[g, v]
                down = m[0, 0] * s[0] + m[0, 1] * s[1] + m[0, 2] * s[2] + margin[0]
                over = m[1, 0] * s[0] + m[1, 1] * s[1] + m[1, 2] * s[2] + margin[1]
                i, j = min(int(down), max(2 * margin[0] - 1, 0)), min(int(over), 2 * margin[1] - 1)
                a, b = down - i, over - j
                near = scores[v, k, i * right + j : i * right + j + 2]
                value = near[0] + b * (near[1] - near[0])
                if a > 0:
                    far = scores[v, k, (i + 1) * right + j : (i + 1) * right + j + 2]
                    value += a * (far[0] + b * (far[1] - far[0]) - value)
                score += value
            top = max(top, score)
            if temperature > 0:
                noise = np.rint(SCORE_STEPS * math.log(-math.log(max(rng.random(), 1e-300))))  # Gumbel's
                score -= temperature * noise / SCORE_STEPS
            if score > best:
                best, rotation, number = score, k, t
    return rotation, number


@nb.njit(cache=CACHE, error_model="numpy")
def _random_subset(rng, numbers, count, current):
    """``count`` random elements of ``numbers`` (all different, shuffled in place), with ``current`` among them."""
    for i in range(count):
        j = i + rng.integers(0, len(numbers) - i)
        numbers[i], numbers[j] = numbers[j], numbers[i]
    subset = numbers[:count].copy()
    if not (subset == current).any():
        subset[0] = current
    return subset


def anneal(rng, temperatures, batch, images, tables, energies, places, anchors, sizes, offsets, gradients, shifts,
           margin, rotation_of, shift_of):  # fmt: skip
    """One sweep over all grains at each of some temperatures, an iterable that may tell how far it is.

    ``rotation_of (n,)`` and ``shift_of (n,)`` are the candidates of the grains, on entry those of the start, on return
    those of the lowest ‖R‖² after any sweep, which is the returned value.
    """
    numbers = np.arange(len(tables)), np.arange(len(shifts))
    best, best_rotations, best_shifts = np.inf, rotation_of.copy(), shift_of.copy()
    for temperature in temperatures:
        cost = _sweep(
            rng, float(temperature), batch, numbers, images, tables, energies, places, anchors, sizes, offsets,
            gradients, shifts, margin, rotation_of, shift_of,
        )  # fmt: skip
        if cost < best:
            best, best_rotations[:], best_shifts[:] = cost, rotation_of, shift_of
    rotation_of[:], shift_of[:] = best_rotations, best_shifts
    return best


@nb.njit(cache=CACHE, error_model="numpy")
def _sweep(rng, temperature, batch, numbers, images, tables, energies, places, anchors, sizes, offsets, gradients,
           shifts, margin, rotation_of, shift_of):  # fmt: skip
    """Visit all grains once, in random order, at one temperature; returns ‖R‖² after it.

    ``rotation_of (n,)`` and ``shift_of (n,)`` are the candidates of the grains, replaced in place.  A visit considers
    at most ``batch`` (rotations, shifts) drawn at random; ``numbers`` are those of all, shuffled in place.  ``images``
    are the residual; ``margin`` (rows, columns) is the largest move.
    """
    rotation_numbers, shift_numbers = numbers
    count = min(batch[0], len(tables)), min(batch[1], len(shifts))
    scores = np.empty((len(images), count[0], (2 * margin[0] + 1) * (2 * margin[1] + 1)))
    for g in rng.permutation(len(rotation_of)):
        chosen_rotations = _random_subset(rng, rotation_numbers, count[0], rotation_of[g])
        chosen_shifts = _random_subset(rng, shift_numbers, count[1], shift_of[g])
        shift = shifts[shift_of[g]]
        _add_grain(images, tables, places, anchors, sizes, offsets, gradients, g, rotation_of[g], shift, 1.0)
        _correlate(images, tables, energies, places, anchors, sizes, offsets, g, margin, chosen_rotations, scores)
        row, shift_of[g] = _draw_candidate(rng, scores, gradients, shifts, chosen_shifts, g, margin, temperature)
        rotation_of[g] = chosen_rotations[row]
        shift = shifts[shift_of[g]]
        _add_grain(images, tables, places, anchors, sizes, offsets, gradients, g, rotation_of[g], shift, -1.0)
    cost = 0.0
    for v in range(len(images)):
        for r in range(images.shape[1]):
            for c in range(images.shape[2]):
                cost += images[v, r, c] ** 2
    return cost
