"""Write docs/command-line.md, all commands, options, exit codes and JSON documents, from the program itself.

python docs/write_command_line_page.py          writes it
python docs/write_command_line_page.py --check  fails if it is not up to date
"""

from __future__ import annotations

import dataclasses
import inspect
import re
import sys
import types
import typing
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_origin

from typer.models import OptionInfo

from grainmotion.cli import documents
from grainmotion.cli.app import app
from grainmotion.cli.exit_codes import EXIT_CODES
from grainmotion.cli.export_commands import export_app
from grainmotion.cli.options import Display
from grainmotion.cli.program import COMMAND_ORDER

Command = Callable[..., None]
KINDS = {Path: "path", str: "text", int: "whole number", float: "number"}
HEAD = """# The command line

Every command and option, made from the program itself by `python docs/write_command_line_page.py`.
`grainmotion --help` shows the commands, `grainmotion run --help` (or `-h`) the options of one of them, and
`grainmotion --version` (or `-V`) the version. `python -m grainmotion` is the same program.

A file or folder instead of a command is inspected: what is in it is told, and the command that comes next. A command
that wants an experiment file and gets something else names the command that makes one.

## Where output goes

Standard output has what was asked for: tables, states, findings, paths. Standard error has progress, findings as they
come, and errors. So `grainmotion run experiment.toml > results.txt` keeps the results and still shows progress. On a
terminal progress is a bar, with the share and the time left of the stage in hand and, once a state is done, of all
states; elsewhere it is a log, one line a step, and one every half minute of a longer step. Kernels are compiled when
they are first used, which is told. Ctrl-C ends a command within two seconds, and what is finished is kept. Each run
also writes `run.log` beside its results: versions, machine, inputs, settings, stages with their times and files,
findings, errors. An error that comes while a run is under way names that file.

`--quiet` hides progress and notes; warnings stay. `--verbose` adds times of stages, and files as they are written.

| variable | meaning |
|---|---|
| `NO_COLOR` | if set, no colours; `--color` replaces it |
| `FORCE_COLOR` | if set, colours also where output goes to no terminal |
| `TERM` | if `dumb`, progress is a log, without a bar |
| `COLUMNS` | width of tables and help, where the terminal does not tell it |
| `NUMBA_CACHE_DIR` | folder of compiled kernels; by default beside the package, or in the user's cache |
| `NUMBA_NUM_THREADS` | threads that compute; by default all cores |

## Dry run

`--dry-run` tells which stages would be done, which would be kept from an earlier run, and why the others are not: not
done yet, a file of theirs is gone, an input or a setting changed, an earlier stage is done again. It estimates time (by
the log of the earlier run where there is one), memory and disk space, and writes nothing. With workers it tells the
memory of each of them too, and warns of those that may use less; a scheduler is asked which workers it has.

## Completion

`grainmotion --install-completion` makes Tab complete commands, options, their words and experiment files in bash, zsh,
fish and PowerShell, from the next shell on. `grainmotion --show-completion` prints the script instead.

## Exit codes

| code | meaning |
|---|---|
"""
JSON = """
## JSON

`--json` prints one JSON document on standard output, also after an error; all else goes to standard error. Lengths are
in mm, angles in degrees, sizes in bytes, paths are absolute; what is not known is `null`. Names may be added in any
version. If one is renamed or removed, or changes its meaning, `schema` goes up.

```sh
grainmotion run experiment.toml --json > run.json
```
"""
TITLES = {
    "Envelope": "The document",
    "ErrorOutcome": "`error`",
    "FindingOutcome": "`findings`",
    "RunOutcome": "`result` of `run`, `reconstruct`, `segment`, `track`, `report` and `export`",
    "DryRunOutcome": "`result` with `--dry-run`",
    "WatchOutcome": "`result` of `watch`",
    "InspectOutcome": "`result` of `inspect` and `init`",
    "ViewOutcome": "`result` of `view`",
    "PlanOutcome": "`result` of `plan`",
    "DemoOutcome": "`result` of `demo`",
    "SimulateOutcome": "`result` of `simulate`",
    "VersionOutcome": "`result` of `version`",
    "StateResult": "`states`",
    "GrainToLookAt": "`look_at`",
    "StagePlan": "`stages`",
    "WorkerPlan": "`workers`",
    "Facts": "`facts`",
    "Line": "`lines`",
    "ScanOutcome": "`scans`",
    "ViewSetOutcome": "`sets`",
    "ComparisonOutcome": "`comparisons`",
}
"""Headings of the records, in order."""


def main() -> None:
    """Write or check the page."""
    page = Path(__file__).with_name("command-line.md")
    text = written()
    if "--check" not in sys.argv:
        page.write_text(text)
    elif page.read_text() != text:
        sys.exit("docs/command-line.md is not up to date: run python docs/write_command_line_page.py")


def written() -> str:
    """The page."""
    codes = [f"| {code} | {meaning} |" for code, meaning in EXIT_CODES.items()]
    commands = [line for name, function in functions() for line in section(name, function)]
    records = [line for name, title in TITLES.items() for line in record(getattr(documents, name), title)]
    return "\n".join([HEAD.rstrip("\n"), *codes, "", *shared(), *commands, JSON.strip("\n"), "", *records])


def functions() -> Iterator[tuple[str, Command]]:
    """The commands by their full name, in the order of the help."""
    top = {str(info.name): info.callback for info in app.registered_commands}
    inner = {f"export {info.name}": info.callback for info in export_app.registered_commands}
    for name in COMMAND_ORDER:
        for full, function in inner.items() if name == "export" else [(name, top[name])]:
            assert function is not None
            yield full, function


def shared() -> Iterator[str]:
    """Options that every command has."""
    yield "## Options of every command\n"
    yield "| option | values | meaning |"
    yield "|---|---|---|"
    for field in dataclasses.fields(Display):
        yield row(typing.get_type_hints(Display, include_extras=True)[field.name], field.default)
    yield "| `--help`, `-h` | | what the command does, with an example, and its options |"
    yield ""


def section(name: str, function: Command) -> Iterator[str]:
    """One command: what it does, examples, arguments and options."""
    text = inspect.cleandoc(function.__doc__ or "")
    about = re.sub(r"^Example: .*$", "", text, flags=re.MULTILINE)
    yield f"## `{name}`\n"
    yield re.sub(r"\n{2,}", "\n\n", about.strip()) + "\n"
    yield "```sh"
    yield from re.findall(r"^Example: (.*)$", text, re.MULTILINE)
    yield "```\n"
    of_every_command = {field.name for field in dataclasses.fields(Display)}
    parameters = [p for p in inspect.signature(function).parameters.values() if p.name not in of_every_command]
    if parameters:
        yield "| argument or option | values | meaning |"
        yield "|---|---|---|"
        yield from (row(p.annotation, p.default) for p in parameters)
        yield ""


def row(annotation: Any, default: Any) -> str:
    """One row of a table of options."""
    declared, info = get_args(annotation)
    option = isinstance(info, OptionInfo)
    written = [info.default, *(info.param_decls or ())]  # typer takes the first name for the default
    names = ", ".join(f"`{word}`" for word in written if isinstance(word, str)) if option else f"`{info.metavar}`"
    return f"| {names} | {values(declared, default)} | {info.help.replace('|', ' or ')} |"


def values(declared: Any, default: Any) -> str:
    """What a parameter takes."""
    kinds = [kind for kind in get_args(declared) or (declared,) if kind is not type(None)]
    kind = kinds[0]
    if kind is bool:
        return ""
    words = ", ".join(f"`{word.value}`" for word in kind) if issubclass(kind, Enum) else KINDS[kind]
    shown = default is not None and default is not inspect.Parameter.empty
    return f"{words}; default `{getattr(default, 'value', default)}`" if shown else words


def record(kind: type, title: str) -> Iterator[str]:
    """A table of the fields of a JSON record."""
    yield f"### {title}\n"
    yield "| name | type | meaning |"
    yield "|---|---|---|"
    hints = typing.get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        declared, meaning = get_args(hints[field.name])
        yield f"| `{field.name}` | {type_name(declared)} | {meaning} |"
    yield ""


def type_name(declared: Any) -> str:
    """A type in the words of JSON."""
    if get_origin(declared) in (types.UnionType, typing.Union):
        parts = get_args(declared)
        named = [type_name(part) for part in parts if part is not type(None)]
        told = "object" if len(named) > 1 else named[0]
        return f"{told} or null" if type(None) in parts else told
    if get_origin(declared) is dict:
        return f"object of {type_name(get_args(declared)[1])}s"
    if get_origin(declared) in (list, tuple):
        inner = [part for part in get_args(declared) if part is not Ellipsis]
        return f"array of {'arrays' if get_origin(inner[0]) in (list, tuple) else type_name(inner[0]) + 's'}"
    return {int: "integer", float: "number", str: "string", bool: "boolean"}.get(declared, "object")


if __name__ == "__main__":
    main()
