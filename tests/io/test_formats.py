"""Image files as scanners and programs write them: compressed, OME, grey in colours, PNG; refusals with a way out."""

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image

from grainmotion.errors import InputError
from grainmotion.io.png import png_info, read_png
from grainmotion.io.stacks import find_stack
from grainmotion.io.tiff import read_tiff, tiff_info

STACK = np.random.default_rng(0).integers(0, 60_000, (5, 24, 30)).astype(np.uint16)


CODECS_WITH_PREDICTOR = ["lzw", "zlib", "zstd", "lzma", "deflate"]


@pytest.mark.parametrize(
    ("codec", "predictor"),
    [*((codec, True) for codec in CODECS_WITH_PREDICTOR),
     *((codec, False) for codec in (*CODECS_WITH_PREDICTOR, "packbits", "lerc"))],
)  # fmt: skip
def test_compressed_tiff(tmp_path, codec, predictor):
    tifffile.imwrite(tmp_path / "a.tif", STACK, compression=codec, predictor=predictor, photometric="minisblack")
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif"), STACK)


def test_lzw_as_pillow_writes_it(tmp_path):
    Image.fromarray(STACK[0]).save(tmp_path / "a.tif", compression="tiff_lzw")
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif")[0], STACK[0])


def test_tiff_compressed_with_loss_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK[0].astype(np.uint8), compression="jpeg")
    with pytest.raises(InputError, match=r"a\.tif: compressed by JPEG, with loss"):
        tiff_info(tmp_path / "a.tif")


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.int16, np.int32, np.uint8, np.uint32])
def test_types_of_numbers(tmp_path, dtype):
    array = (STACK // 256).astype(dtype)
    tifffile.imwrite(tmp_path / "a.tif", array, photometric="minisblack")
    read = read_tiff(tmp_path / "a.tif")
    assert read.dtype == dtype
    np.testing.assert_array_equal(read, array)


def test_imagej_stack_of_time_and_depth(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", STACK[:4].reshape(2, 2, 24, 30), imagej=True, metadata={"axes": "TZYX"})
    np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif"), STACK[:4])


class TestOme:
    """Files of one plane each that name all files of the set as one volume, as microscopes' software writes them."""

    @pytest.fixture
    def folder(self, tmp_path):
        ids = [f"urn:uuid:00000000-0000-0000-0000-00000000000{k}" for k in range(3)]
        data = "".join(
            f'<TiffData FirstZ="{k}" IFD="0" PlaneCount="1"><UUID FileName="p_{k}.ome.tif">{name}</UUID></TiffData>'
            for k, name in enumerate(ids)
        )
        for k, name in enumerate(ids):
            xml = (
                f'<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="{name}">'
                '<Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="30" SizeY="24" '
                f'SizeZ="3" SizeC="1" SizeT="1"><Channel ID="Channel:0:0" SamplesPerPixel="1"/>{data}</Pixels></Image>'
                "</OME>"
            )
            tifffile.imwrite(tmp_path / f"p_{k}.ome.tif", STACK[k], description=xml, metadata=None)
        return tmp_path

    def test_each_file_is_one_image(self, folder):
        with tifffile.TiffFile(folder / "p_0.ome.tif") as file:
            assert file.series[0].shape == (3, 24, 30)  # what the file claims to be part of
        stack = find_stack("*.ome.tif", folder)
        assert stack.info()[0] == (3, 24, 30)
        np.testing.assert_array_equal(stack.read(), STACK[:3])

    def test_a_missing_file_of_the_set_is_not_read_as_zeros(self, folder):
        (folder / "p_1.ome.tif").unlink()
        np.testing.assert_array_equal(find_stack("*.ome.tif", folder).read(), STACK[[0, 2]])

    def test_all_planes_in_one_file(self, tmp_path):
        tifffile.imwrite(tmp_path / "a.ome.tif", STACK, metadata={"axes": "ZYX"})
        np.testing.assert_array_equal(read_tiff(tmp_path / "a.ome.tif"), STACK)


class TestColour:
    def test_grey_in_all_channels_is_read(self, tmp_path):
        tifffile.imwrite(tmp_path / "a.tif", np.repeat(STACK[0, ..., None], 3, -1), photometric="rgb")
        assert tiff_info(tmp_path / "a.tif")[0] == (1, 24, 30)
        np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif")[0], STACK[0])

    def test_opacity_is_left_out(self, tmp_path):
        image = np.repeat(STACK[0, ..., None], 4, -1)
        image[..., 3] = 65535
        tifffile.imwrite(tmp_path / "a.tif", image, photometric="rgb", extrasamples=["unassalpha"])
        np.testing.assert_array_equal(read_tiff(tmp_path / "a.tif")[0], STACK[0])

    def test_colours_are_refused(self, tmp_path):
        image = np.repeat(STACK[0, ..., None], 3, -1)
        image[3, 4, 1] += 1
        tifffile.imwrite(tmp_path / "a.tif", image, photometric="rgb")
        with pytest.raises(InputError, match="red, green and blue differ"):
            read_tiff(tmp_path / "a.tif")

    def test_colour_map_is_refused(self, tmp_path):
        image = STACK[0].astype(np.uint8)
        tifffile.imwrite(tmp_path / "a.tif", image, photometric="palette", colormap=np.zeros((3, 256), np.uint16))
        with pytest.raises(InputError, match="colour map"):
            read_tiff(tmp_path / "a.tif")


class TestPng:
    @pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
    def test_grey_of_8_and_16_bits(self, tmp_path, dtype):
        for k, image in enumerate(STACK.astype(dtype)):
            Image.fromarray(image).save(tmp_path / f"p_{k}.png")
        stack = find_stack("*.png", tmp_path)
        assert stack.info() == (STACK.shape, np.dtype(dtype))
        np.testing.assert_array_equal(stack.read(), STACK.astype(dtype))
        np.testing.assert_array_equal(stack.read(np.array([3, 1])), STACK[[3, 1]].astype(dtype))

    def test_16_bits_in_grey_colours(self, tmp_path):
        (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(np.repeat(STACK[0, ..., None], 3, -1)))
        np.testing.assert_array_equal(read_png(tmp_path / "a.png")[0], STACK[0])

    def test_palettes_and_bits_are_refused(self, tmp_path):
        Image.fromarray(STACK[0] > 30_000).save(tmp_path / "bits.png")
        Image.fromarray(STACK[0].astype(np.uint8)).convert("P").save(tmp_path / "palette.png")
        for name in ("bits", "palette"):
            with pytest.raises(InputError, match="its pixels are no counts"):
                png_info(tmp_path / f"{name}.png")

    @pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.9])
    def test_truncated_file_is_refused(self, tmp_path, share):
        Image.fromarray(STACK[0]).save(tmp_path / "a.png")
        whole = (tmp_path / "a.png").read_bytes()
        (tmp_path / "a.png").write_bytes(whole[: int(len(whole) * share)])
        with pytest.raises(InputError, match=r"a\.png"):
            read_png(tmp_path / "a.png")


@pytest.mark.parametrize(
    ("name", "fact"),
    [
        ("a.jpg", "compressed with loss"),
        ("a.JPEG", "compressed with loss"),
        ("a.raw", r"bytes without a header.*numpy.fromfile\(\"a.raw\""),
        ("a.npz", "archive of several arrays; save the one of the images"),
        ("a.txm", r"a volume that Zeiss's software has reconstructed; give the radiographs \(.txrm\)"),
        ("a.edf", "fabio.open"),
        ("a", "it has no suffix; give TIFF files"),
    ],
)
def test_other_formats_are_refused_with_a_way_out(tmp_path, name, fact):
    (tmp_path / name).write_bytes(b"something")
    with pytest.raises(InputError, match=fact):
        find_stack(name, tmp_path)


@pytest.mark.parametrize("name", ["scan.xtekct", "scan.log", "scan.pca"])
def test_descriptions_of_scans_are_named_alone(tmp_path, name):
    (tmp_path / name).write_text("[x]\n")
    with pytest.raises(InputError, match=rf'without its images; name it alone, radiographs = "{name}"'):
        find_stack(["a.tif", name] if (tmp_path / "a.tif").exists() else [name, name], tmp_path)
