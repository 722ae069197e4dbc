"""What `inspect` and `init` tell: printed at once, and kept for the JSON document."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from grainmotion.cli.documents import Facts, InspectOutcome, Line
from grainmotion.cli.terminal import Terminal

if TYPE_CHECKING:
    from pathlib import Path

    from grainmotion.experiment.inspection import Inspection
    from grainmotion.model.finding import Finding


class Description:
    """A description of a file or folder; text goes to standard output as it comes, unless JSON is wanted."""

    def __init__(self, path: Path, terminal: Terminal) -> None:
        self.terminal = terminal
        self.document = InspectOutcome(str(path.absolute()))
        self.found: list[Finding] = []

    def facts(self, title: str, facts: Sequence[tuple[str, str]]) -> None:
        """Facts under a title: label and text of each, one a line."""
        self.document.facts.append(Facts(title, [(label, text) for label, text in facts]))
        self._print(title)
        width = max((len(label) for label, _ in facts), default=0)
        for label, text in facts:
            self._print(f"  {label:<{width}}  {text}")

    def line(self, key: str, text: object) -> None:
        """One thing, by what it is."""
        self.document.lines.append(Line(key, str(text)))
        self._print(f"{key}: {text}")

    def sentence(self, text: str, key: str = "orientation") -> None:
        """A sentence that needs no heading on the terminal."""
        self.document.lines.append(Line(key, text))
        self._print(text)

    def drawing(self, text: str) -> None:
        """A drawing of characters, for the terminal alone."""
        self._print(text)

    def findings(self, findings: Iterable[Finding]) -> None:
        """What is unusual."""
        for finding in findings:
            self.found.append(finding)
            if not self.terminal.json:
                self.terminal.message(finding.line)

    def inspection(self, inspection: Inspection) -> None:
        """Scans and volume of an experiment, and its findings."""
        from grainmotion.cli.json_output import scan_outcome
        from grainmotion.cli.tables import print_inspection
        from grainmotion.model.finding import worst_first

        self.document = dataclasses.replace(
            self.document,
            scans=[scan_outcome(facts) for facts in inspection.scans],
            volume_shape=inspection.volume_shape,
            voxel_size=inspection.voxel_size,
            memory=int(inspection.memory),
        )
        if not self.terminal.json:
            print_inspection(self.terminal, inspection)
        self.findings(worst_first(inspection.findings))

    def _print(self, text: str) -> None:
        if not self.terminal.json:
            print(text)
