"""Voxels of a grain in an eighth of the memory: whole numbers of 8 bits, only where the grain is.

Grains upsampled twice have eight times the voxels of the reference.  Of thousands of grains these would be the most
that a run holds, so they are kept as whole numbers and made single precision again, always the same, batch by batch as
they are projected.  Rounding is even noise of 1/780 of a grain's largest voxel, a tenth of the noise of a good
reconstruction or less (decision 0063); a grain with voxels far denser than the rest is kept in 16 bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from grainmotion.kernels.voxel_lines import write_lines
from grainmotion.model.volume import Volume

STEPS_ABOVE, STEPS_BELOW = 224, 31
"""Steps up to the highest voxel of a grain and down to the lowest, which noise makes negative, in 8 bits."""
STEPS_OF_MORE = 32_767
"""Steps up to the largest voxel, of either sign, in 16 bits."""
MIN_STEPS = 112
"""Steps up to a grain's typical attenuation from which 8 bits are enough."""


@dataclass(frozen=True, eq=False, repr=False)
class CompactVolume:
    """A `Volume` in single precision, rounded to 1/224 of its largest voxel, or to 1/32,767.

    Attributes
    ----------
    values : (k,) uint8 or int16 array
        Voxels over ``unit``, plus ``zero``, from the first to the last of each line along x that is not zero, line
        after line.
    zero : int
        The whole number of a voxel without attenuation.
    firsts, ends : (nz * ny,) uint16 array
        Where these voxels begin and end in each line.
    unit : float
        Attenuation of 1, 1/mm.
    shape : (int, int, int)
        Voxels along z, y, x.
    voxel_size : float
        Edge of a voxel, mm.
    center : (3,) tuple of float
        Centre of the whole array in the sample frame, mm, x y z.
    """

    values: NDArray[np.uint8] | NDArray[np.int16]
    zero: int
    firsts: NDArray[np.uint16]
    ends: NDArray[np.uint16]
    unit: np.float32
    shape: tuple[int, int, int]
    voxel_size: float
    center: tuple[float, float, float]

    @classmethod
    def of(cls, volume: Volume) -> CompactVolume:
        """The voxels of a volume, rounded."""
        lines = volume.array.reshape(-1, volume.shape[2])
        low, high = float(lines.min()), float(lines.max())
        step, zero = max(high / STEPS_ABOVE, -low / STEPS_BELOW, 1e-30), STEPS_BELOW
        kind: type[np.uint8 | np.int16] = np.uint8
        mass = float(np.abs(lines).sum(dtype=float))
        if float(np.vdot(lines, lines)) < MIN_STEPS * step * mass:  # the mean attenuation of its attenuation
            step, zero, kind = max(high, -low, 1e-30) / STEPS_OF_MORE, 0, np.int16
        unit = np.float32(step)
        rounded = (np.rint(lines / unit) + zero).astype(kind)
        filled = rounded != zero
        some = filled.any(axis=1)
        firsts = np.where(some, filled.argmax(axis=1), 0)
        ends = np.where(some, lines.shape[1] - filled[:, ::-1].argmax(axis=1), 0)
        places = np.arange(lines.shape[1])
        kept = (places >= firsts[:, None]) & (places < ends[:, None])
        limits = firsts.astype(np.uint16), ends.astype(np.uint16)
        return cls(rounded[kept], zero, *limits, unit, volume.shape, volume.voxel_size, volume.center)

    @property
    def array(self) -> NDArray[np.float32]:
        """The voxels ``(nz, ny, nx)``, made anew each time."""
        out = np.empty(self.size, np.float32)
        self.write(out)
        return out.reshape(self.shape)

    def write(self, out: NDArray[np.float32]) -> None:
        """Fill a flat array with the voxels."""
        write_lines(self.values, self.zero, self.firsts, self.ends, self.unit, self.shape[2], out)

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """Number type of the voxels once they are made."""
        return np.dtype(np.float32)

    @property
    def size(self) -> int:
        """Number of voxels."""
        return int(np.prod(self.shape))

    @property
    def nbytes(self) -> int:
        """Memory that is held."""
        return self.values.nbytes + self.firsts.nbytes + self.ends.nbytes

    @property
    def origin(self) -> NDArray[np.float64]:
        """Position (x, y, z) of the centre of voxel [0, 0, 0], mm."""
        return np.array(self.center) - (np.array(self.shape[::-1]) - 1) / 2 * self.voxel_size

    @property
    def volume(self) -> Volume:
        """The same with all voxels in memory."""
        return Volume(self.array, self.voxel_size, self.center)


@dataclass(frozen=True, eq=False)
class CompactVoxels:
    """The voxels of many grains, those of row ``starts[g]`` of a `GrainTable` for grain g."""

    volumes: Sequence[CompactVolume]

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """The precision of the voxels once they are made."""
        return np.dtype(np.float32)

    @property
    def sizes(self) -> NDArray[np.int64]:
        """Voxels of each once they are made."""
        return np.array([volume.size for volume in self.volumes], dtype=np.int64)

    def end_to_end(self, rows: NDArray[np.int64]) -> CompactVoxels:
        """Some of them, whose numbers lie one after the other in three arrays, so that few files hold them."""
        some = [self.volumes[k] for k in rows]
        parts = []
        for name in ("values", "firsts", "ends"):
            arrays = [getattr(volume, name) for volume in some]
            whole = np.concatenate(arrays)
            edges = np.cumsum([0, *map(len, arrays)])
            parts.append([whole[a:b] for a, b in pairwise(edges.tolist())])
        return CompactVoxels([replace(v, values=a, firsts=b, ends=c) for v, a, b, c in zip(some, *parts, strict=True)])

    def written(self, rows: NDArray[np.int64]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """The voxels of some volumes one after the other, and where each begins."""
        ends = np.cumsum([self.volumes[k].size for k in rows])
        starts = np.concatenate([[0], ends[:-1]]).astype(np.int64)
        out = np.empty(ends[-1], np.float32)
        for k, start, end in zip(rows, starts, ends, strict=True):
            self.volumes[k].write(out[start:end])
        return out, starts
