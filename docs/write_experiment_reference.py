"""Write docs/experiment.md, every key of the experiment file, from the tables themselves.

python docs/write_experiment_reference.py          writes it
python docs/write_experiment_reference.py --check  fails if it is not up to date
"""

from __future__ import annotations

import dataclasses
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from grainmotion.calibration.settings import ScannerSettings
from grainmotion.diagnosis.settings import CheckSettings
from grainmotion.experiment import config, scan_tables
from grainmotion.grain_shapes.settings import DemSettings
from grainmotion.mechanics.settings import MechanicsSettings
from grainmotion.planning.plan import PlanSettings
from grainmotion.reconstruction.reconstruct import ReconstructSettings
from grainmotion.segmentation.settings import BodySettings, PhaseSettings, SegmentSettings
from grainmotion.tracking.track import TrackSettings

TABLES: dict[str, type] = {
    "[reference]": scan_tables.ReferenceTable,
    "[reference.geometry], [states.geometry]": scan_tables.Circular,
    "[reference.air]": scan_tables.Air,
    "[volume]": config.VolumeTable,
    "[check]": CheckSettings,
    "[calibrate]": ScannerSettings,
    "[reconstruct]": ReconstructSettings,
    "[segment]": SegmentSettings,
    "[[segment.phases]]": PhaseSettings,
    "[[segment.bodies]]": BodySettings,
    "[track]": TrackSettings,
    "[plan]": PlanSettings,
    "[mechanics]": MechanicsSettings,
    "[[states]]": scan_tables.StateTable,
    "[watch]": scan_tables.WatchTable,
    "[output]": config.OutputTable,
    "[dem]": DemSettings,
}
HEAD = """# The experiment file

`grainmotion init FOLDER` writes a first file from a folder of measurements. This one is complete, for a circular scan
in a cone beam:

```toml
[reference]                          # the full scan of the initial state
radiographs = "reference/*.tif"
flats = "flats/*.tif"
darks = "darks/*.tif"

[reference.geometry]
source_to_axis = 120                 # mm
source_to_detector = 480             # mm
pixel_size = 0.2                     # mm, on the panel
first_row = "top"                    # row 0 of the images is the top of the sample
angles_deg = { first = 0, last = 359.5, count = 720 }

[[states]]                           # one table a state, in loading order
name = "step-01"
radiographs = "step-01/*.tif"        # flats and darks are those of the reference unless given here
geometry = { angles_deg = [0, 45, 90, 135] }    # so are the other numbers of the geometry
```

Other ways to give a scan are in [scanners](scanners.md), volumes and labels of other programs in
[volumes](volumes.md), axes and signs in [conventions](conventions.md). A file of views has 12 numbers a row
([conventions](conventions.md#a-view-is-12-numbers)).

The tables below list every key; they are made from the program's own tables by
`python docs/write_experiment_reference.py`. Paths start at the file's folder. Lengths are in mm, angles in degrees. Any
other key is an error, which names the nearest known one.
"""


def main() -> None:
    """Write or check the page."""
    page = Path(__file__).with_name("experiment.md")
    text = "\n".join([HEAD, *(line for name, table in TABLES.items() for line in section(name, table))])
    if "--check" not in sys.argv:
        page.write_text(text)
    elif page.read_text() != text:
        sys.exit("docs/experiment.md is not up to date: run python docs/write_experiment_reference.py")


def section(name: str, table: type) -> Iterator[str]:
    """The table of one TOML table's keys."""
    yield f"## `{name}`\n"
    yield f"{(table.__doc__ or '').strip().splitlines()[0]}\n"
    yield "| key | default | meaning |"
    yield "|---|---|---|"
    for key, default, meaning in keys(table):
        yield f"| `{key}` | {default} | {meaning.replace('|', ' or ')} |"
    yield ""


def keys(table: type) -> Iterator[tuple[str, str, str]]:
    """Key, default and meaning of each field of a pydantic model or dataclass."""
    if dataclasses.is_dataclass(table):
        hints = typing.get_type_hints(table, include_extras=True)
        for field in dataclasses.fields(table):
            meaning = next(a.description for a in get_args(hints[field.name]) if isinstance(a, FieldInfo))
            yield field.name, shown(field.default), str(meaning)
    else:
        fields: dict[str, FieldInfo] = table.model_fields  # type: ignore[attr-defined]
        for key, info in fields.items():
            assert info.description, f"{table.__name__}.{key} has no description"
            yield key, shown(info.get_default(call_default_factory=True)), info.description


def shown(value: Any) -> str:
    """A default as TOML writes it."""
    if value in (PydanticUndefined, dataclasses.MISSING):
        return "required"
    if value is None:
        return ""
    if isinstance(value, tuple):
        return f"`{list(value)}`"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    return f'`"{value}"`' if isinstance(value, str) else f"`{value}`"


if __name__ == "__main__":
    main()
