"""HDF5: compressed data, data in other files or never written, names that are wrong, angles with units."""

import h5py
import hdf5plugin
import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.io.hdf5 import dataset_info, read_angles_deg, read_dataset, read_nxtomo
from grainmotion.io.stacks import find_stack

STACK = np.arange(12 * 8 * 10, dtype=np.uint16).reshape(12, 8, 10)
FILTERS = {
    "blosc": hdf5plugin.Blosc(),
    "bitshuffle": hdf5plugin.Bitshuffle(),
    "lz4": hdf5plugin.LZ4(),
    "zstd": hdf5plugin.Zstd(),
    "gzip": {"compression": "gzip"},
}


@pytest.mark.parametrize("name", FILTERS)
def test_compressed_dataset(tmp_path, name):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("data", data=STACK, chunks=(1, 8, 10), **FILTERS[name])
    np.testing.assert_array_equal(find_stack("a.h5::/data", tmp_path).read(), STACK)


class TestOtherFiles:
    @pytest.fixture
    def virtual(self, tmp_path):
        """A virtual dataset over three files of four images."""
        layout = h5py.VirtualLayout((12, 8, 10), np.uint16)
        for k in range(3):
            with h5py.File(tmp_path / f"part_{k}.h5", "w") as file:
                file["data"] = STACK[4 * k : 4 * k + 4]
            layout[4 * k : 4 * k + 4] = h5py.VirtualSource(f"part_{k}.h5", "data", (4, 8, 10))
        with h5py.File(tmp_path / "all.h5", "w") as file:
            file.create_virtual_dataset("data", layout, fillvalue=0)
        return tmp_path

    def test_complete_virtual_dataset_is_read(self, virtual, monkeypatch):
        np.testing.assert_array_equal(read_dataset(virtual / "all.h5", "data"), STACK)
        monkeypatch.chdir(virtual)
        np.testing.assert_array_equal(read_dataset("all.h5", "data"), STACK)

    def test_missing_member_is_named(self, virtual):
        (virtual / "part_1.h5").unlink()
        for read in (dataset_info, read_dataset):
            with pytest.raises(InputError, match=r"of which 1 are missing: part_1\.h5.*zeros instead"):
                read(virtual / "all.h5", "data")

    def test_missing_dataset_in_a_member_is_named(self, virtual):
        with h5py.File(virtual / "part_2.h5", "a") as file:
            del file["data"]
        with pytest.raises(InputError, match=r"part_2\.h5::data"):
            read_dataset(virtual / "all.h5", "data")

    def test_missing_member_of_nxtomo_frames(self, virtual):
        with h5py.File(virtual / "all.h5", "a") as file:
            file.move("data", "entry/instrument/detector/data")
            file["entry/instrument/detector/image_key"] = np.zeros(12, int)
        assert find_stack("all.h5", virtual).read().shape == STACK.shape
        (virtual / "part_0.h5").unlink()
        with pytest.raises(InputError, match=r"part_0\.h5"):
            find_stack("all.h5", virtual).read()

    def test_external_link(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["entry/data"] = h5py.ExternalLink("raw.h5", "/data")
        with pytest.raises(InputError, match=r"'/entry/data' is a link to raw\.h5, which is not there"):
            dataset_info(tmp_path / "a.h5", "/entry/data")
        with h5py.File(tmp_path / "raw.h5", "w") as file:
            file["data"] = STACK
        np.testing.assert_array_equal(read_dataset(tmp_path / "a.h5", "/entry/data"), STACK)

    def test_frames_of_nxtomo_behind_a_link(self, tmp_path):
        with h5py.File(tmp_path / "a.nxs", "w") as file:
            file["entry/instrument/detector/data"] = h5py.ExternalLink("raw.h5", "/data")
            file["entry/instrument/detector/image_key"] = np.zeros(12, int)
        with pytest.raises(InputError, match=r"a link to raw\.h5, which is not there"):
            read_nxtomo(tmp_path / "a.nxs")
        with h5py.File(tmp_path / "raw.h5", "w") as file:
            file["data"] = STACK
        np.testing.assert_array_equal(find_stack("a.nxs", tmp_path).read(), STACK)


class TestNeverWritten:
    @pytest.mark.parametrize("chunks", [(1, 8, 10), (2, 4, 10)])
    def test_interrupted_scan(self, tmp_path, chunks):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("data", (12, 8, 10), np.uint16, chunks=chunks)[:6] = STACK[:6]
        with pytest.raises(InputError, match="images 6 to 11 of '/data' were never written"):
            read_dataset(tmp_path / "a.h5", "data")
        np.testing.assert_array_equal(read_dataset(tmp_path / "a.h5", "data", np.arange(6)), STACK[:6])
        with pytest.raises(InputError, match="images 7 of"):
            read_dataset(tmp_path / "a.h5", "data", np.array([1, 7]))

    def test_nothing_written(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("data", (12, 8, 10), np.uint16)
        with pytest.raises(InputError, match="images 0 to 11"):
            read_dataset(tmp_path / "a.h5", "data")

    def test_frames_of_zeros_that_were_written_are_data(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("data", data=0 * STACK, chunks=(1, 8, 10), compression="gzip")
        assert not read_dataset(tmp_path / "a.h5", "data").any()


@pytest.mark.parametrize(
    ("inner", "fact"),
    [
        ("/exchange/dat", r"did you mean '/exchange/data'\? it holds"),
        ("/exchange", r"'/exchange' is a group; name a dataset in it: /exchange/data \(12, 8, 10\), /exchange/theta"),
        ("/nothing", "no dataset '/nothing'; it holds /exchange/data, /exchange/theta"),
        ("/exchange/theta", r"a.h5::/exchange/theta: an array of shape \(12,\) is no stack"),
    ],
)
def test_wrong_names_get_the_near_ones(tmp_path, inner, fact):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["exchange/data"], file["exchange/theta"] = STACK, np.arange(12)
    with pytest.raises(InputError, match=fact):
        find_stack(f"a.h5::{inner}", tmp_path).info()


def test_file_without_nxtomo_names_its_stacks(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["exchange/data"], file["exchange/theta"] = STACK, np.arange(12)
    with pytest.raises(InputError, match=r'it holds /exchange/data; name one dataset in it as "a.h5::/exchange/data"'):
        find_stack("a.h5", tmp_path).info()


class TestAngles:
    @pytest.mark.parametrize(
        "units", ["rad", " rad", b"radian", np.array(["rad"], dtype=object), np.array([b"rad"]), "Radians"]
    )
    def test_units_as_programs_write_them(self, tmp_path, units):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["theta"] = np.radians([0.0, 30, 60])
            file["theta"].attrs["units"] = units
        np.testing.assert_allclose(read_angles_deg(tmp_path / "a.h5", "/theta"), [0, 30, 60])

    def test_without_units_they_are_degrees(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["theta"] = [0, 30, 60]
        np.testing.assert_allclose(read_angles_deg(tmp_path / "a.h5", "/theta"), [0, 30, 60])

    def test_unknown_unit_of_nxtomo_is_refused(self, tmp_path):
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file["entry/instrument/detector/data"] = STACK
            file["entry/instrument/detector/image_key"] = np.zeros(12, int)
            file["entry/sample/rotation_angle"] = np.arange(12.0)
            file["entry/sample/rotation_angle"].attrs["units"] = "steps"
        with pytest.raises(InputError, match="unknown unit 'steps'"):
            read_nxtomo(tmp_path / "a.h5")
