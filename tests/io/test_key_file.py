"""Files of sections and keys as scanners' software writes them, and images by the numbers in their names."""

import numpy as np
import pytest
import tifffile

from grainmotion.errors import InputError
from grainmotion.io.scanners.key_file import KeyFile, as_number
from grainmotion.io.scanners.numbered_images import numbered_images, series_of_scan

TEXT = (
    "head = 1\r\n; a comment = 2\r\n[Ünits]\r\nPath=C:\\a=b\r\nEmpty=\r\nPitch = 0,25\r\nPITCH=0,5\r\nnoise\r\n[x\r\n"
)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_sections_and_keys_in_any_case_and_encoding(tmp_path, encoding):
    (tmp_path / "a.ini").write_bytes(TEXT.encode(encoding))
    keys = KeyFile.read(tmp_path / "a.ini")
    assert keys.text("ünits", "PATH") == "C:\\a=b"
    assert keys.number("Ünits", "pitch") == 0.5  # the last of two
    assert keys.number("", "head") == 1
    assert keys.number("Ünits", "Empty") is None
    assert keys.number("other", "key") is None
    assert set(keys.sections) == {"", "ünits"}


@pytest.mark.parametrize(
    ("text", "number"),
    [("1,5", 1.5), (" 1.5e-3 ", 1.5e-3), ("-2", -2.0), ("1.234,5", None), ("nan", None), ("inf", None), ("", None)],
)
def test_numbers_of_any_language(text, number):
    assert as_number(text) == number


def test_a_needed_key_names_file_section_and_key(tmp_path):
    (tmp_path / "a.ini").write_text("[S]\nk=-1\nn=2.5\n")
    keys = KeyFile.read(tmp_path / "a.ini")
    with pytest.raises(InputError, match=r"a\.ini \[S\] other: it is missing: the file is truncated or altered"):
        keys.needed("S", "other")
    with pytest.raises(InputError, match=r"a\.ini \[S\] k: -1 is not above 0"):
        keys.needed("S", "k")
    with pytest.raises(InputError, match=r"a\.ini \[S\] n: 2.5 is no number of images"):
        keys.count("S", "n")


def test_images_by_number_not_as_text(tmp_path):
    """9 before 10, letters of any case, no other scan, no preview."""
    names = ["p9.tif", "p10.TIF", "P1.tiff", "p_3.tif", "p2_rec.tif", "pp4.tif", "p5.txt"]
    for name in names:
        tifffile.imwrite(tmp_path / name, np.zeros((2, 2), np.uint16)) if name != "p5.txt" else None
    assert list(numbered_images(tmp_path, "p")) == [1, 9, 10]


def test_padded_numbers_may_outgrow_their_padding(tmp_path):
    for name in ("s_09.tif", "s_10.tif", "s_100.tif", "s_0011.tif"):
        tifffile.imwrite(tmp_path / name, np.zeros((2, 2), np.uint16))
    assert list(numbered_images(tmp_path, "s_")) == [9, 10, 100]


def test_missing_numbers_are_named_in_ranges(tmp_path):
    images = {n: tmp_path / f"{n}.tif" for n in (1, 2, 5, 9, 12, 13, 15, 17, 19, 21)}
    kept, (finding,) = series_of_scan("file", images, range(1, 22))
    assert kept == images
    assert "10 of 21 images are there; 3-4, 6-8, 10-11, 14 and 3 more ranges are missing" in finding.fact
