"""Which files hold images, by their suffix, and what to do about those that cannot be measured from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

from grainmotion.errors import InputError

TIFF, PNG, NPY = (".tif", ".tiff", ".btf"), (".png",), (".npy",)
TXRM = (".txrm", ".xrm")
HDF5 = (".h5", ".hdf5", ".hdf", ".nxs", ".nx", ".nx5")
FORMATS = 'give TIFF files (.tif), .png, .npy, "file.h5::/path/to/data" or one file of a scanner (.nxs, .txrm)'
KNOWN = (TIFF, PNG, NPY, HDF5, TXRM)

_NPY_START = b"\x93NUMPY"
_LOSSY = "compressed with loss: counts are altered in blocks of 8 x 8 pixels, which no correction undoes"
_EXPORT = "export the scan as 16-bit TIFF with the scanner's software"
_BYTES = "bytes without a header, so that size and type of the images are unknown"
_CONVERT = (
    'convert it once in Python, with the numbers of the scanner\'s log, and give "scan.npy": '
    'numpy.save("scan.npy", numpy.fromfile("{name}", dtype="<u2", offset=0).reshape(images, rows, columns))'
)
_REFUSED: Mapping[str, tuple[str, str]] = MappingProxyType({
    suffix: (fact, remedy)
    for suffixes, fact, remedy in (
        (".jpg .jpeg .jfif .webp", _LOSSY, "export the radiographs again, as 16-bit TIFF"),
        (".jp2 .j2k .jxl", "JPEG 2000 or JPEG XL, which may be compressed with loss", "export as 16-bit TIFF"),
        (".raw .bin .dat .img .vol .bsq", _BYTES, _CONVERT),
        (".npz", "an archive of several arrays", "save the one of the images with numpy.save, as .npy"),
        (".bmp .gif", "an image for screens, of 8 bits", "export the radiographs as 16-bit TIFF"),
        (".txm", "a volume that Zeiss's software has reconstructed", "give the radiographs (.txrm), or TIFF of it"),
        (".his .seq", "a file of PerkinElmer's own format", _EXPORT),
        (".xtekct .log .pca", "a description of a scan, without its images",
         'name it alone, radiographs = "{name}", or name the TIFF files of the scan'),
        (".vgi .vgl .xtekvolume", "a description of a volume, without its images", "name its TIFF files"),
        (".edf", "ESRF's data format", 'convert it with fabio: numpy.save("scan.npy", fabio.open("{name}").data)'),
        (".mat", "a file of Matlab", 'save with -v7.3 and name the array: "file.h5::/name", after renaming to .h5'),
        (".zip .gz .7z .tar .rar", "an archive", "unpack it"),
        (".dcm .nii .mha .mhd .nrrd", "a format of medical images", "export the images as 16-bit TIFF"),
    )
    for suffix in suffixes.split()
})  # fmt: skip


def family(path: Path) -> tuple[str, ...] | None:
    """The suffixes of the format of a file; None if it is none that can be read."""
    suffix = path.suffix.lower()
    return next((suffixes for suffixes in KNOWN if suffix in suffixes), None)


def check_npy(path: Path) -> None:
    """Refuse a file called .npy that numpy.save did not write."""
    with path.open("rb") as file:
        start = file.read(len(_NPY_START))
    if start != _NPY_START:
        fact = "no file of numpy.save, whatever its name says: it does not begin with \\x93NUMPY"
        raise InputError(str(path), fact, "save the array with numpy.save, or name the file by what it is")


def unreadable(path: Path) -> InputError:
    """The error about a file of a format that cannot be read: why, and how to convert it."""
    suffix = path.suffix.lower()
    if suffix in _REFUSED:
        fact, remedy = _REFUSED[suffix]
        return InputError(str(path), fact, remedy.replace("{name}", path.name))
    return InputError(str(path), f"the format '{suffix}' is unknown" if suffix else "it has no suffix", FORMATS)
