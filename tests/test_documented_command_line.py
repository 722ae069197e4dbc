"""`docs/command-line.md` is what its script makes of the program."""

from __future__ import annotations

import runpy

from documented_blocks import ROOT


def test_the_page_is_up_to_date():
    written = runpy.run_path(str(ROOT / "docs" / "write_command_line_page.py"))["written"]
    assert (ROOT / "docs" / "command-line.md").read_text() == written()
