"""What moved or appeared beside the whole grains, in the group ``fit`` of a ``motions.h5``: one row each.

``fit/bodies`` holds `BodyMotion`, ``fit/appeared`` `NewGrain` and ``fit/pieces`` `PieceMotion`, every field as a
dataset under its own name, in mm and **radians**; a group is there only if it has rows.
"""

from __future__ import annotations

import h5py
import numpy as np

from grainmotion.model.state_fit import BodyMotion, NewGrain, PieceMotion, StateFit

_MOTION = {"center": "mm", "translation": "mm", "rotation": "rad", "covariance": "of mm, mm, mm, rad, rad, rad"}
_BODY_TEXTS = ("name", "kind", "freedom")
_NEW_GRAIN = {"center": "mm", "center_sd": "mm", "radius": "mm", "radius_sd": "mm", "attenuation": "1/mm"}
_PIECE = {"label": "1", "piece": "1", "share": "1"}
"""Arrays of each kind of row and their units."""


def write_parts(fit: h5py.Group, state: StateFit) -> None:
    """Write bodies, new grains and pieces into the group ``fit``."""
    text = h5py.string_dtype()
    if state.bodies:
        group = fit.create_group("bodies")
        for name in _BODY_TEXTS:
            group.create_dataset(name, data=[getattr(body, name) for body in state.bodies], dtype=text)
        group["moved"] = np.array([body.moved for body in state.bodies])
        _write_arrays(group, state.bodies, _MOTION)
    if state.appeared:
        _write_arrays(fit.create_group("appeared"), state.appeared, _NEW_GRAIN)
    if state.pieces:
        group = fit.create_group("pieces")
        group.create_dataset("status", data=[piece.status for piece in state.pieces], dtype=text)
        _write_arrays(group, state.pieces, _PIECE | _MOTION)


def _write_arrays(group: h5py.Group, rows: tuple[object, ...], units: dict[str, str]) -> None:
    for name, unit in units.items():
        group.create_dataset(name, data=np.array([getattr(row, name) for row in rows])).attrs["unit"] = unit


def read_bodies(fit: h5py.Group) -> tuple[BodyMotion, ...]:
    """The motions of the bodies; in a file of an older version that of the one background."""
    if "background" in fit:
        motion = fit["background"][()]
        unknown, moved = np.full(3, np.nan), bool(motion.any())
        return (BodyMotion("rest", "rest", "free", unknown, motion[:3], motion[3:], np.full((6, 6), np.nan), moved),)
    if "bodies" not in fit:
        return ()
    group = fit["bodies"]
    texts = [group[name].asstr()[()] for name in _BODY_TEXTS]
    arrays, moved = {name: group[name][()] for name in _MOTION}, group["moved"][()]
    return tuple(
        BodyMotion(
            str(name),
            str(kind),
            str(freedom),
            **{array: rows[k] for array, rows in arrays.items()},
            moved=bool(moved[k]),
        )
        for k, (name, kind, freedom) in enumerate(zip(*texts, strict=True))
    )


def read_new_grains(fit: h5py.Group) -> tuple[NewGrain, ...]:
    """Grains that appeared; none in files of older versions."""
    if "appeared" not in fit:
        return ()
    columns = [fit["appeared"][name][()] for name in _NEW_GRAIN]
    return tuple(
        NewGrain(center, sd, float(radius), float(radius_sd), float(attenuation))
        for center, sd, radius, radius_sd, attenuation in zip(*columns, strict=True)
    )


def read_pieces(fit: h5py.Group) -> tuple[PieceMotion, ...]:
    """Motions of the pieces of broken grains; none in files of older versions."""
    if "pieces" not in fit:
        return ()
    group = fit["pieces"]
    statuses = group["status"].asstr()[()]
    arrays = {name: group[name][()] for name in (*_PIECE, *_MOTION)}
    return tuple(
        PieceMotion(
            int(arrays["label"][k]),
            int(arrays["piece"][k]),
            float(arrays["share"][k]),
            **{name: arrays[name][k] for name in _MOTION},
            status=str(status),
        )
        for k, status in enumerate(statuses)
    )
