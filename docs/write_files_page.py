"""Write docs/files.md, every file of a results folder, from the package's own catalogue.

python docs/write_files_page.py          writes it
python docs/write_files_page.py --check  fails if it is not up to date
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from grainmotion.io.catalogue import FILES, FileKind
from grainmotion.model.described_table import SAMPLE_FRAME, Columns

HEAD = f"""# Files of a results folder

Every file that a run writes, made from the program's own catalogue by `python docs/write_files_page.py`. STATE stands
for the folder of each state. Lengths are in mm and angles in degrees in tables, in **radians** in motions.h5. Frame:
{SAMPLE_FRAME} ([conventions](conventions.md)). Unit "1" is a number without a unit.

Each file can be read without the package: tables by `pandas.read_csv`, HDF5 by `h5py`, TIFF by `tifffile`, JSON by
`json`. Attributes of HDF5 files, the first keys of JSON files and the description of residuals.tif say what they hold.
Tables are described by `datapackage.json`, a [Frictionless Data Package](https://datapackage.org) with type, unit and
meaning of each column, the version and the settings of the run. In Python `Motions.to_dataframe().attrs` holds the
same, and `grainmotion.read_results(folder)` reads a folder.

| file | holds | written |
|---|---|---|
"""


def main() -> None:
    """Write or check the page."""
    page = Path(__file__).with_name("files.md")
    rows = [f"| {_link(kind)} | {kind.content} | {kind.when} |" for kind in FILES]
    text = HEAD + "\n".join([*rows, "", *(line for kind in FILES for line in section(kind))]).rstrip() + "\n"
    if "--check" not in sys.argv:
        page.write_text(text)
    elif page.read_text() != text:
        sys.exit("docs/files.md is not up to date: run python docs/write_files_page.py")


def _link(kind: FileKind) -> str:
    anchor = "".join(c for c in kind.path.lower() if c.isalnum() or c in "-_ ")
    return f"[`{kind.path}`](#{anchor})"


def section(kind: FileKind) -> Iterator[str]:
    """Lines of one kind of file."""
    yield f"## `{kind.path}`"
    yield ""
    yield " ".join(f"{text[0].upper()}{text[1:]}." for text in (kind.content, kind.note) if text)
    yield ""
    if kind.columns:
        yield from _table("column", kind.columns)
    if kind.items:
        yield from _table("key" if kind.path.endswith(".json") else "dataset or attribute", kind.items)


def _table(first: str, columns: Columns) -> Iterator[str]:
    yield f"| {first} | unit | meaning |"
    yield "|---|---|---|"
    for name, (unit, meaning) in columns.items():
        yield f"| `{name}` | {unit} | {meaning} |"
    yield ""


if __name__ == "__main__":
    main()
