"""Run the tutorials: write the output of each command below it, and draw the pictures of docs/images/tutorial.

python docs/write_tutorial.py             all
python docs/write_tutorial.py NAME.md     one page

`tests/test_tutorial.py` runs them in the same way and compares.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from typer.testing import CliRunner

from grainmotion.cli.app import app

DOCS = Path(__file__).parent
PAGES = ("tutorial.md", "tutorial-own-data.md")
STEP = re.compile(
    r"^```(?P<language>sh|python|toml)\n(?P<code>.*?)^```$(?:\n\n```\n(?P<output>.*?)^```$)?", re.MULTILINE | re.DOTALL
)
"""A block that is run, and the plain block behind it with its output."""


class Step(NamedTuple):
    """One block of a page: what it printed as the page has it (None if the page shows nothing) and as it ran."""

    match: re.Match[str]
    output: str

    @property
    def shown(self) -> str | None:
        """The output on the page."""
        return self.match["output"]


def steps(text: str, folder: Path) -> Iterator[Step]:
    """Run the blocks of a page in order, in a folder; those of Python share their names.

    A block of settings whose first line is a comment with a path is written to that file.
    """
    names: dict[str, object] = {"__name__": "__main__"}
    for match in STEP.finditer(text):
        with contextlib.chdir(folder), contextlib.redirect_stdout(io.StringIO()) as printed:
            if match["language"] == "sh":
                for line in match["code"].splitlines():
                    print(run_command(shlex.split(line, comments=True)), end="")
            elif match["language"] == "python":
                exec(compile(match["code"], "tutorial", "exec"), names)
            else:
                path, _, settings = match["code"].removeprefix("# ").partition("\n")
                Path(path).write_text(settings, encoding="utf-8")
        yield Step(match, without_trailing_spaces(printed.getvalue()))


def run_command(words: list[str]) -> str:
    """What a command of grainmotion prints; an error if it fails."""
    if words[0] != "grainmotion":
        raise ValueError(f"the tutorial runs commands of grainmotion only, not {words[0]}")
    result = CliRunner().invoke(app, words[1:])
    if result.exit_code:
        raise RuntimeError(f"{shlex.join(words)} ended with {result.exit_code}:\n{result.output}") from result.exception
    return result.output  # as a terminal shows it: progress, then results


def without_trailing_spaces(text: str) -> str:
    """Lines without spaces at their ends; one line break at the end."""
    return "".join(f"{line.rstrip()}\n" for line in text.splitlines())


def written(text: str, folder: Path) -> str:
    """The page with the outputs of this run."""
    parts, end = [], 0
    for step in steps(text, folder):
        if step.shown is not None:
            begin, stop = step.match.span("output")
            parts += [text[end:begin], step.output]
            end = stop
    return "".join([*parts, text[end:]])


def main() -> None:
    """Write the pages and the pictures."""
    os.environ.setdefault("COLUMNS", "120")
    with tempfile.TemporaryDirectory() as folder:
        names = sys.argv[1:] or PAGES
        for name in names:
            page = DOCS / name
            page.write_text(written(page.read_text(encoding="utf-8"), Path(folder)), encoding="utf-8")
        if "tutorial.md" not in names:
            return
        sys.path.insert(0, str(DOCS / "images"))
        from make_tutorial import draw

        draw(Path(folder) / "shear")


if __name__ == "__main__":
    main()
