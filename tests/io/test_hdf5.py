"""Reading NXtomo files: frames selected by image key, angles in degrees."""

import h5py
import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.io.hdf5 import DARK, FLAT, read_nxtomo
from grainmotion.io.stacks import find_stack


def nxtomo(path, *, unit="deg", entry="entry", control=True):
    """Write dark, flat, four projections (one of them for alignment), an invalid frame and a flat."""
    frames = np.arange(8, dtype=np.uint16)[:, None, None] + np.zeros((8, 4, 5), np.uint16)
    keys = np.array([2, 1, 0, 0, 0, 3, 0, 1])
    angles = np.array([0, 0, 0, 30, 60, 70, 90, 90], float)
    with h5py.File(path, "w") as file:
        group = file.create_group(entry)
        group["instrument/detector/data"] = frames
        group["instrument/detector/image_key"] = keys
        if control:
            group["instrument/detector/image_key_control"] = np.where(np.arange(8) == 6, -1, keys)
        group["sample/rotation_angle"] = np.deg2rad(angles) if unit == "rad" else angles
        group["sample/rotation_angle"].attrs["units"] = unit
    return path


class TestNXtomo:
    @pytest.mark.parametrize("entry", ["entry", "entry1/tomo_entry"])
    @pytest.mark.parametrize("unit", ["deg", "rad"])
    def test_frames_are_selected_by_image_key(self, tmp_path, entry, unit):
        file = read_nxtomo(nxtomo(tmp_path / "a.nxs", entry=entry, unit=unit))
        np.testing.assert_allclose(file.projection_angles_deg, [0, 30, 60])
        stack = find_stack("a.nxs", tmp_path)
        assert stack.info()[0] == (3, 4, 5)
        assert stack.read()[:, 0, 0].tolist() == [2, 3, 4]
        assert stack.frames(FLAT).read()[:, 0, 0].tolist() == [1, 7]
        assert stack.frames(DARK).read()[:, 0, 0].tolist() == [0]

    def test_without_control_keys_all_projections_are_read(self, tmp_path):
        file = read_nxtomo(nxtomo(tmp_path / "a.nxs", control=False))
        np.testing.assert_allclose(file.projection_angles_deg, [0, 30, 60, 90])

    def test_keys_must_match_frames(self, tmp_path):
        path = nxtomo(tmp_path / "a.nxs", control=False)
        with h5py.File(path, "a") as file:
            del file["entry/instrument/detector/image_key"]
            file["entry/instrument/detector/image_key"] = [0, 1]
        with pytest.raises(InputError, match="2 image keys"):
            read_nxtomo(path)
