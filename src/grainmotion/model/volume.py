"""Volume: a voxel image with its place in the sample frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from grainmotion._arguments import check_argument
from grainmotion.errors import InputError
from grainmotion.model.described_table import SAMPLE_FRAME
from grainmotion.model.field_of_view import FieldOfView
from grainmotion.model.hardening import LINEAR, Hardening
from grainmotion.model.large_arrays import large_zeros
from grainmotion.model.precision import precision_of
from grainmotion.model.summary import Summarised, Summary, shape_text, size_text, vector_text
from grainmotion.model.thumbnails import grey_picture

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class Volume(Summarised):
    """Attenuation per unit length on a grid of cubic voxels.

    Attributes
    ----------
    array : (nz, ny, nx) float32 or float64 array
        Attenuation at the voxels' centres, in 1/mm, indexed ``[z, y, x]``.  Double precision is kept, and
        grains extracted from it are tracked in it; anything else becomes float32.
    voxel_size : float
        Edge of a voxel, mm.
    center : (3,) tuple of float
        Centre of the whole array in the sample frame, mm, x y z.
    field : FieldOfView, optional
        What of it the scan saw from which it was reconstructed; None if that is not known.
    hardening : Hardening
        Curve by which the scan was linearised before it was reconstructed; radiographs that are compared with the
        volume must go through it, too.

    Raises
    ------
    InputError
        If the array is not three-dimensional, is empty or holds NaN, the voxel size is not positive, or
        the centre is not three finite numbers.

    Examples
    --------
    >>> grid = gm.Volume.zeros((96, 72, 72), voxel_size=0.125)  # z, y, x; mm
    >>> grid.shape, grid.origin.tolist()  # x, y, z of the centre of voxel [0, 0, 0]
    ((96, 72, 72), [-4.4375, -4.4375, -5.9375])
    """

    array: NDArray[np.floating]
    voxel_size: float
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    field: FieldOfView | None = None
    hardening: Hardening = LINEAR

    def __post_init__(self) -> None:
        with np.errstate(over="ignore"):  # larger values become infinite, which is refused below
            array = np.ascontiguousarray(self.array, dtype=precision_of(self.array))
        if array.ndim != 3 or array.size == 0:
            raise InputError("volume", f"shape {array.shape} is not (z, y, x)", "give a 3-D stack")
        if not all(np.isfinite(plane).all() for plane in array):
            raise InputError("volume", "it holds NaN or infinite voxels", "replace them, by 0 for air")
        check_argument("Volume(voxel_size)", self.voxel_size, ["float"])
        if not (np.isfinite(self.voxel_size) and self.voxel_size > 0):
            raise InputError("volume.voxel_size", f"must be > 0, got {self.voxel_size}", "give it in mm")
        if np.shape(self.center) != (3,) or not np.isfinite(self.center).all():
            raise InputError("volume.center", f"{self.center} is not 3 finite numbers", "give x, y, z in mm")
        object.__setattr__(self, "array", array)
        object.__setattr__(self, "voxel_size", float(self.voxel_size))
        x, y, z = (float(c) for c in self.center)
        object.__setattr__(self, "center", (x, y, z))

    @classmethod
    def zeros(
        cls, shape: tuple[int, int, int], voxel_size: float, center: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ) -> Volume:
        """An empty volume: the grid on which to reconstruct.

        Parameters
        ----------
        shape : (int, int, int)
            Voxels along z, y, x.
        voxel_size : float
            Edge of a voxel, mm.
        center : (float, float, float)
            Centre of the grid in the sample frame, mm, x y z.

        Returns
        -------
        Volume
            Of zeros.

        Raises
        ------
        InputError
            If the shape is not three whole numbers above 0.
        """
        check_argument("Volume.zeros(shape)", shape, ["tuple[int, int, int]"])
        if min(shape) < 1:
            raise InputError("Volume.zeros(shape)", f"it is {shape_text(shape)} voxels", "give whole numbers above 0")
        return cls(large_zeros(shape, np.float32), voxel_size, center)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Voxels along z, y, x."""
        nz, ny, nx = self.array.shape
        return nz, ny, nx

    @property
    def dtype(self) -> np.dtype[np.floating]:
        """Number type of the voxels."""
        return self.array.dtype

    @property
    def origin(self) -> NDArray[np.float64]:
        """Position (x, y, z) of the centre of voxel [0, 0, 0], mm."""
        half = (np.array(self.shape[::-1]) - 1) / 2 * self.voxel_size
        return np.array(self.center) - half

    def cropped(self, mask: NDArray[np.bool_]) -> Volume:
        """Some of the voxels, on the smallest grid that holds those that are not zero.

        Parameters
        ----------
        mask : (nz, ny, nx) bool array
            Voxels to keep; the others become zero.

        Returns
        -------
        Volume
            In its place; one empty voxel if nothing is left.
        """
        filled = (own & (plane != 0) for own, plane in zip(mask, self.array, strict=True))
        heights, columns = np.zeros(self.shape[0], bool), np.zeros(self.shape[1:], bool)
        for k, plane in enumerate(filled):
            heights[k] = plane.any()
            columns |= plane
        box = []
        for places in map(np.flatnonzero, (heights, columns.any(axis=1), columns.any(axis=0))):
            box.append(slice(int(places[0]), int(places[-1]) + 1) if len(places) else slice(0, 1))
        part = large_zeros(mask[tuple(box)].shape, self.array.dtype)
        np.copyto(part, self.array[tuple(box)], where=mask[tuple(box)])
        starts = np.array([s.start for s in box[::-1]])
        x, y, z = self.origin + self.voxel_size * (starts + (np.array(part.shape[::-1]) - 1) / 2)
        return Volume(part, self.voxel_size, (float(x), float(y), float(z)))

    def to_xarray(self) -> xr.DataArray:
        """The volume as an xarray, with the places of its voxels: for slices by mm and plots with axes.

        Returns
        -------
        DataArray
            Dimensions z, y, x with coordinates in mm, attenuation in 1/mm; its ``attrs`` tell voxel size and frame.

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        try:
            import xarray as xr  # optional, and slow to load
        except ImportError as error:
            fact, remedy = "xarray is not installed", "pip install 'grainmotion[notebook]'"
            raise InputError("Volume.to_xarray", fact, remedy) from error
        places = (self.origin[2 - k] + self.voxel_size * np.arange(n) for k, n in enumerate(self.shape))
        coordinates = {axis: (axis, place, {"units": "mm"}) for axis, place in zip("zyx", places, strict=True)}
        about = {"units": "1/mm", "long_name": "attenuation", "voxel_size": self.voxel_size, "frame": SAMPLE_FRAME}
        return xr.DataArray(self.array, coordinates, ("z", "y", "x"), name="attenuation", attrs=about)

    def _summary(self) -> Summary:
        size = " × ".join(f"{n * self.voxel_size:.4g}" for n in self.shape)
        rows = (
            ("voxels (z, y, x)", f"{shape_text(self.shape)} of {self.voxel_size:.5g} mm: {size} mm"),
            ("centre (x, y, z)", f"{vector_text(np.array(self.center))} mm"),
            ("array", f"{self.array.dtype}, {size_text(self.array.nbytes)}, attenuation in 1/mm"),
        )
        line = f"{shape_text(self.shape)} voxels (z, y, x) of {self.voxel_size:.5g} mm"
        line += f", centre {rows[1][1]}" if any(self.center) else ""
        return Summary("Volume", line, rows, grey_picture(self.array[self.shape[0] // 2], upwards=True))
