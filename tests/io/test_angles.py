"""Angles from text files as programs write them, and their units."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.io.angles import in_degrees, read_angles

ANGLES = np.arange(12) * 6.25


def column(values, form="{:.2f}"):
    return "\n".join(form.format(a) for a in values)


def commas(text):
    return text.replace(".", ",")


def table(separator, header="", first=0):
    rows = [f"{k + first}{separator}{a:.2f}" for k, a in enumerate(ANGLES)]
    return "\n".join([header, *rows] if header else rows)


FILES = {
    "column": column(ANGLES),
    "column of numpy": column(ANGLES, "{:.18e}"),
    "column in radians": "angle (rad)\n" + column(np.radians(ANGLES), "{:.10f}"),
    "comment": f"# degrees\n{column(ANGLES)} # end\n\n",
    "header": f"angle_deg\n{column(ANGLES)}\n",
    "header with blanks": f"rotation angle\n{column(ANGLES)}\n",
    "byte order mark, ends of Windows": "\ufeff" + column(ANGLES).replace("\n", "\r\n"),
    "ends of old Macintosh": column(ANGLES).replace("\n", "\r"),
    "decimal commas": commas(column(ANGLES)),
    "header and decimal commas": "Winkel\n" + commas(column(ANGLES)),
    "one line, commas": ",".join(f"{a:g}" for a in ANGLES),
    "one line, commas and blanks": ", ".join(f"{a:g}" for a in ANGLES),
    "one line, blanks": " ".join(f"{a:g}" for a in ANGLES),
    "one line, tabs": "\t".join(f"{a:g}" for a in ANGLES) + "\n",
    "one line, semicolons and decimal commas": "; ".join(commas(f"{a:g}") for a in ANGLES),
    "one line, blanks and decimal commas": " ".join(commas(f"{a:.2f}") for a in ANGLES),
    "trailing commas": column(ANGLES, "{:.2f},"),
    "quotation marks": column(ANGLES, '"{:.2f}"'),
    "index, commas": table(","),
    "index from 1, semicolons": table(";", first=1),
    "index, tabs and decimal commas": commas(table("\t")),
    "index, semicolons, decimal commas, header": "Bild;Winkel\n" + commas(table(";")),
    "index, blanks": table("   "),
    "header that names the column": table(",", "index,angle_deg"),
    "header of three columns": "time,theta,current\n" + "\n".join(f"{7 * k},{a},0.1" for k, a in enumerate(ANGLES)),
    "header with radians": "n,angle_rad\n" + "\n".join(f"{k},{np.radians(a):.10f}" for k, a in enumerate(ANGLES)),
}


@pytest.mark.parametrize("kind", FILES)
def test_files_of_angles(tmp_path, kind):
    (tmp_path / "angles.csv").write_bytes(FILES[kind].encode())
    np.testing.assert_allclose(read_angles(tmp_path / "angles.csv"), ANGLES, atol=1e-6)


def test_whole_angles_separated_by_commas_are_no_decimals(tmp_path):
    (tmp_path / "a.txt").write_text("0,6,12,18\n")
    np.testing.assert_array_equal(read_angles(tmp_path / "a.txt"), [0, 6, 12, 18])
    (tmp_path / "a.txt").write_text("\n".join(f"{k},{6 * k}" for k in range(60)))
    np.testing.assert_array_equal(read_angles(tmp_path / "a.txt"), np.arange(60) * 6)
    (tmp_path / "a.txt").write_text("\n".join(f"{k},00" for k in range(60)))  # 1,00 is one
    np.testing.assert_array_equal(read_angles(tmp_path / "a.txt"), np.arange(60))


@pytest.mark.parametrize(
    ("text", "fact"),
    [
        ("0\n30\nsixty\n90\n", "line 3 is 'sixty'"),
        ("0\n30\nnan\n90\n", "line 3 is 'nan', and an angle is a finite number"),
        ("0\n1e999\n", None),
        ("", "empty"),
        ("# nothing\n", "it holds no angle"),
        ("0.5,0.1\n6.5,0.1\n12.5,0.2\n", "2 columns, and which of them holds the angles is not clear"),
        ("0,5\n1,5\n2,5\n", "'2,5' may be one number with a decimal comma, or"),
        ("0,10\n1,20\n2,30\n", "may be one number with a decimal comma"),
        ("0 6 1\n1 12 1\n2 18 1\n", "3 columns"),
        ("0 6\n1 12\n2\n", "line 3 has another number of columns than line 1, 2"),
    ],
)
def test_unclear_files_are_refused(tmp_path, text, fact):
    (tmp_path / "a.txt").write_text(text)
    if fact is None:
        assert not np.isfinite(read_angles(tmp_path / "a.txt")).all()  # the geometry refuses it
        return
    with pytest.raises(InputError, match=fact):
        read_angles(tmp_path / "a.txt")


def test_array_and_spreadsheet(tmp_path):
    np.save(tmp_path / "a.npy", ANGLES[:, None])
    np.testing.assert_array_equal(read_angles(tmp_path / "a.npy"), ANGLES)
    np.save(tmp_path / "a.npy", np.zeros((3, 4)))
    with pytest.raises(InputError, match=r"an array \(3, 4\) of float64; give one angle a view"):
        read_angles(tmp_path / "a.npy")
    (tmp_path / "a.xlsx").write_bytes(b"PK\x03\x04rest")
    with pytest.raises(InputError, match="a spreadsheet or an archive, no text; save the sheet as CSV"):
        read_angles(tmp_path / "a.xlsx")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le"])
def test_utf_16_is_named(tmp_path, encoding):
    (tmp_path / "a.txt").write_bytes(column(ANGLES).encode(encoding))
    with pytest.raises(InputError, match="save it as UTF-8"):
        read_angles(tmp_path / "a.txt")


@pytest.mark.parametrize(
    ("unit", "turn"),
    [
        ("", 360), ("deg", 360), ("Degrees", 360), ("°", 360), (" rad", 2 * np.pi), ("radians", 2 * np.pi),
        ("mrad", 2000 * np.pi), ("turn", 1), ("gon", 400), ("mdeg", 360_000),
    ],
)  # fmt: skip
def test_units(unit, turn):
    assert in_degrees(np.array([turn / 4]), unit, "a")[0] == pytest.approx(90)


def test_unknown_unit_is_refused():
    with pytest.raises(InputError, match="unknown unit 'steps'"):
        in_degrees(np.zeros(3), "steps", "scan.h5::/angles")
