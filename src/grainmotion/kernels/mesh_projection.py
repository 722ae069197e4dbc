# mypy: allow-untyped-defs
"""Kernels: exact line integrals through meshes, ellipsoids and tubes, on sub-sampled pixels.

A ray of a view is written in the view's own coordinates q, in which (column, row) is constant along it.
Cone beam, with P₀ the centre of pixel (0, 0) and S the source:

    x = S + λ (P(c, r) − S),   P = P₀ + c u + r v,   q = [u v P₀−S]⁻¹ (x − S) = λ (c, r, 1);

parallel beam, with rays along the unit vector s:  q = [u v s]⁻¹ (x − P₀) = (c, r, λ).  A triangle stays a
triangle in (c, r), and its plane m·q = h gives λ at any sample.  The path through a closed mesh is
Σ ± λ over the triangles that a ray crosses, + where it leaves the mesh.  Triangles are filled row by row.
The crossing of an edge with a row of samples is always computed from the edge's lower to its upper end, so
that both triangles at the edge get the same bits and no ray passes between them.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from grainmotion.kernels.compilation import CACHE


@numba.njit(cache=CACHE)
def _crossing(xa, ya, xb, yb, row):
    """Column at which an edge crosses a row; the same bits whichever end is given first."""
    if ya > yb:
        xa, ya, xb, yb = xb, yb, xa, ya
    return xa + (row - ya) * (xb - xa) / (yb - ya)


@numba.njit(cache=CACHE)
def _add_triangle(image, q, positions, a, b, c, weight, cone, per_pixel):
    """Add ± weight · λ of one triangle to ``image`` (rows·k, columns·k), where k = ``per_pixel``.

    ``positions`` are those of the vertices in samples (column, row).
    """
    xa, ya = positions[a, 0], positions[a, 1]
    xb, yb = positions[b, 0], positions[b, 1]
    xc, yc = positions[c, 0], positions[c, 1]
    first = max(0, math.ceil(min(ya, yb, yc)))
    last = min(image.shape[0] - 1, math.floor(max(ya, yb, yc)))
    if first > last:
        return
    low, high = min(q[a, 2], q[b, 2], q[c, 2]), max(q[a, 2], q[b, 2], q[c, 2])
    e0, e1, e2 = q[b, 0] - q[a, 0], q[b, 1] - q[a, 1], q[b, 2] - q[a, 2]
    f0, f1, f2 = q[c, 0] - q[a, 0], q[c, 1] - q[a, 1], q[c, 2] - q[a, 2]
    m0, m1, m2 = e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0
    h = m0 * q[a, 0] + m1 * q[a, 1] + m2 * q[a, 2]
    for row in range(first, last + 1):
        up, down = np.inf, np.inf  # columns at which the rising and the falling edge cross this row
        if (ya <= row) != (yb <= row):
            x = _crossing(xa, ya, xb, yb, row)
            up, down = (x, down) if ya <= row else (up, x)
        if (yb <= row) != (yc <= row):
            x = _crossing(xb, yb, xc, yc, row)
            up, down = (x, down) if yb <= row else (up, x)
        if (yc <= row) != (ya <= row):
            x = _crossing(xc, yc, xa, ya, row)
            up, down = (x, down) if yc <= row else (up, x)
        if up == np.inf or down == np.inf:
            continue
        signed = weight if up > down else -weight
        r = (row + 0.5) / per_pixel - 0.5
        left, right = max(0, math.ceil(min(up, down))), min(image.shape[1], math.ceil(max(up, down)))
        for column in range(left, right):
            x = (column + 0.5) / per_pixel - 0.5
            if cone:
                bottom = m0 * x + m1 * r + m2
                depth = h / bottom if bottom != 0.0 else low
            else:
                depth = (h - m0 * x - m1 * r) / m2 if m2 != 0.0 else low
            image[row, column] += signed * min(max(depth, low), high)


@numba.njit(cache=CACHE)
def _interval(o, d, radius, z0, z1):
    """λ range of the ray o + λ d inside a cylinder about the z axis from z0 to z1; (0, 0) if it misses."""
    a = d[0] * d[0] + d[1] * d[1]
    cross = o[0] * d[1] - o[1] * d[0]
    disc = radius * radius * a - cross * cross
    if disc <= 0.0 or a == 0.0:
        return 0.0, 0.0
    half, middle = math.sqrt(disc) / a, -(o[0] * d[0] + o[1] * d[1]) / a
    enter, leave = middle - half, middle + half
    if d[2] != 0.0:
        t0, t1 = (z0 - o[2]) / d[2], (z1 - o[2]) / d[2]
        enter, leave = max(enter, min(t0, t1)), min(leave, max(t0, t1))
    elif o[2] < z0 or o[2] > z1:
        return 0.0, 0.0
    return enter, max(enter, leave)


@numba.njit(cache=CACHE)
def _ray(view, cone, x, y, o, d):
    """Origin and direction of the ray through column x and row y, both counted from the panel's centre."""
    for i in range(3):
        point = view[3 + i] + x * view[6 + i] + y * view[9 + i]
        o[i] = view[i] if cone else point
        d[i] = point - view[i] if cone else view[i]


@numba.njit(cache=CACHE)
def _add_ellipsoid(image, view, cone, per_pixel, box, center, whitening, weight):
    """Add weight × chord (in λ) of an ellipsoid within ``box``: first and last row, first and last column."""
    rows, columns = image.shape[0] // per_pixel, image.shape[1] // per_pixel
    o, d, p, e = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for row in range(box[0], box[1] + 1):
        for column in range(box[2], box[3] + 1):
            x = (column + 0.5) / per_pixel - columns / 2
            _ray(view, cone, x, (row + 0.5) / per_pixel - rows / 2, o, d)
            for i in range(3):
                p[i] = e[i] = 0.0
                for j in range(3):
                    p[i] += whitening[i, j] * (o[j] - center[j])
                    e[i] += whitening[i, j] * d[j]
            a = e[0] * e[0] + e[1] * e[1] + e[2] * e[2]
            c0, c1, c2 = p[1] * e[2] - p[2] * e[1], p[2] * e[0] - p[0] * e[2], p[0] * e[1] - p[1] * e[0]
            disc = a - (c0 * c0 + c1 * c1 + c2 * c2)
            if disc > 0.0:
                image[row, column] += weight * 2.0 * math.sqrt(disc) / a


@numba.njit(cache=CACHE)
def _in_frame(o, d, frame, p, e):
    """Write the ray (o, d) in another frame as (p, e); ``frame`` is its origin (3), then its axes as rows (3 × 3)."""
    for i in range(3):
        p[i] = e[i] = 0.0
        for j in range(3):
            p[i] += frame[3 + 3 * i + j] * (o[j] - frame[j])
            e[i] += frame[3 + 3 * i + j] * d[j]


@numba.njit(cache=CACHE)
def _finish(image, view, cone, per_pixel, tube, attenuation, by_intensity, weights, ratios, out):
    """Convert λ to mm, add the tube, and average each pixel's samples into its transmission."""
    rows, columns = out.shape
    o, d, p, e = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for row in range(rows):
        for column in range(columns):
            mean = 0.0
            for sub in range(per_pixel * per_pixel):
                i, j = row * per_pixel + sub // per_pixel, column * per_pixel + sub % per_pixel
                x, y = (j + 0.5) / per_pixel - columns / 2, (i + 0.5) / per_pixel - rows / 2
                _ray(view, cone, x, y, o, d)
                path = image[i, j]
                if attenuation != 0.0:
                    _in_frame(o, d, tube[4:], p, e)
                    enter, leave = _interval(p, e, tube[1], tube[2], tube[3])
                    path += attenuation * (leave - enter)
                    enter, leave = _interval(p, e, tube[0], tube[2], tube[3])
                    path -= attenuation * (leave - enter)
                path *= math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
                if by_intensity:
                    for k in range(len(weights)):
                        mean += weights[k] * math.exp(-ratios[k] * path)
                else:
                    mean += path
            mean /= per_pixel * per_pixel
            if by_intensity:
                out[row, column] = mean
            else:
                out[row, column] = 0.0
                for k in range(len(weights)):
                    out[row, column] += weights[k] * math.exp(-ratios[k] * mean)


@numba.njit(cache=CACHE, parallel=True)
def transmission(
    views, cone, vertices, faces, face_weights, centers, whitenings, weights, boxes, inverses, origins,
    signs, tube, tube_attenuation, per_pixel, by_intensity, spectrum, ratios, out,
):  # fmt: skip
    """Fill ``out`` (views, rows, columns) with the transmitted fraction of the beam.

    Directions of parallel ``views`` have unit length.  ``inverses`` and ``origins`` map a vertex to q, ``signs`` are
    the handedness of (u, v, ray).  ``boxes`` (views, ellipsoids, 4) bound the footprints of the ellipsoids, in samples.
    ``tube`` (16) is inner and outer radius, bottom, top, and the tube's frame.
    """
    for n in numba.prange(len(views)):
        image = np.zeros((out.shape[1] * per_pixel, out.shape[2] * per_pixel))
        q, positions = np.empty((len(vertices), 3)), np.empty((len(vertices), 2))
        for v in range(len(vertices)):
            x, y, z = (
                vertices[v, 0] - origins[n, 0],
                vertices[v, 1] - origins[n, 1],
                vertices[v, 2] - origins[n, 2],
            )
            for i in range(3):
                q[v, i] = inverses[n, i, 0] * x + inverses[n, i, 1] * y + inverses[n, i, 2] * z
            scale = 1.0 / q[v, 2] if cone else 1.0
            for i in range(2):
                positions[v, i] = (q[v, i] * scale + 0.5) * per_pixel - 0.5
        for f in range(len(faces)):
            a, b, c = faces[f]
            _add_triangle(image, q, positions, a, b, c, signs[n] * face_weights[f], cone, per_pixel)
        for e in range(len(centers)):
            _add_ellipsoid(image, views[n], cone, per_pixel, boxes[n, e], centers[e], whitenings[e], weights[e])
        _finish(image, views[n], cone, per_pixel, tube, tube_attenuation, by_intensity, spectrum, ratios, out[n])
