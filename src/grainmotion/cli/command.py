"""The decorator that makes a command of a function.

Commands import what they run inside their bodies, so that ``--help`` loads no numerical library.  They return an
`Outcome`, or what gives one and is still to be run; this module prints it as text or as one JSON document, and turns
exceptions into messages and exit codes.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Callable
from contextvars import ContextVar
from typing import TYPE_CHECKING, get_type_hints

import typer

from grainmotion.cli.exit_codes import EPILOG, OUTPUT_CLOSED
from grainmotion.cli.failures import Failure, failure
from grainmotion.cli.help_options import Command
from grainmotion.cli.interrupts import Stop, stoppable
from grainmotion.cli.options import OPTION_RECORDS, Display
from grainmotion.cli.outcome import Outcome
from grainmotion.cli.parameters import NAME, keep_types
from grainmotion.cli.streams import drop_output, output_is_closed
from grainmotion.cli.terminal import Terminal
from grainmotion.model.finding import Finding

if TYPE_CHECKING:
    from grainmotion.cli.documents import Document

HELP_OPTIONS = {"help_option_names": ["-h", "--help"]}
CommandFunction = Callable[..., Outcome | Callable[[], Outcome]]


@dataclasses.dataclass
class Call:
    """One call of a command: its name, the signal that stopped it, and the findings that came before it ended."""

    name: str
    stop: Stop
    found: list[Finding] = dataclasses.field(default_factory=list)


_CALL: ContextVar[Call] = ContextVar("call")


def current_call() -> Call:
    """The call that is carried out."""
    return _CALL.get()


def add_command(app: typer.Typer, function: CommandFunction, panel: str | None = None, name: str | None = None) -> None:
    """Add a command to an application, under the name of its function, in a panel of its help.

    A parameter that is one of `OPTION_RECORDS` stands for its fields.
    """
    hints = get_type_hints(function, include_extras=True)
    records = {name: hint for name, hint in hints.items() if hint in OPTION_RECORDS}
    name = name or function.__name__
    title = f"{app.info.name} {name}" if app.info.name != NAME else name

    def invoke(**values: object) -> None:
        for key, record in records.items():
            values[key] = record(**{field.name: values.pop(field.name) for field in dataclasses.fields(record)})
        display = next(value for value in values.values() if isinstance(value, Display))
        code = carried_out(lambda: function(**values), title, display.terminal)
        if code:
            raise typer.Exit(code)

    parameters = _parameters(function, records)
    keep_types(f"{NAME} {title}", parameters)
    invoke.__name__, invoke.__doc__ = name, function.__doc__
    invoke.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    invoke.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    app.command(name, cls=Command, epilog=EPILOG, rich_help_panel=panel, context_settings=HELP_OPTIONS)(invoke)


def _parameters(function: CommandFunction, records: dict[str, type]) -> list[inspect.Parameter]:
    """The parameters of a function, with those that are records replaced by their fields."""
    parameters = []
    for parameter in inspect.signature(function).parameters.values():
        parts = [parameter]
        if parameter.name in records:
            parts = list(inspect.signature(records[parameter.name]).parameters.values())
        for part in parts:
            annotation = get_type_hints(records.get(parameter.name, function), include_extras=True)[part.name]
            parameters.append(part.replace(annotation=annotation, kind=inspect.Parameter.KEYWORD_ONLY))
    return parameters


def carried_out(function: CommandFunction, name: str, terminal: Terminal) -> int:
    """Carry out a command, print its outcome or why it failed, and return the exit code."""
    with stoppable() as stop:
        call = Call(name, stop)
        token = _CALL.set(call)
        try:
            answer = function()
            outcome = answer if isinstance(answer, Outcome) else answer()
            code, reason = outcome.ending.code, outcome.ending.reason
            text = _document(name, outcome.document, outcome.findings, (code, reason)) if terminal.json else ""
            stop.is_late()
            if terminal.json:
                print(text, flush=True)
            else:
                outcome.show(terminal)
                if reason:
                    print(f"exit code {code}: {reason}", file=sys.stderr)
            return code
        except typer.Exit:
            raise
        except (Exception, KeyboardInterrupt) as error:
            if isinstance(error, BrokenPipeError) and output_is_closed():
                drop_output()
                return OUTPUT_CLOSED
            failed = failure(error, stop)
        finally:
            _CALL.reset(token)
    print_failure(failed, name, terminal, tuple(call.found))
    return failed.code


def print_failure(failed: Failure, name: str, terminal: Terminal, findings: tuple[Finding, ...] = ()) -> None:
    """One line on standard error and, if wanted, a JSON document on standard output."""
    text = _document(name, None, findings, (failed.code, failed.fact), failed) if terminal.json else ""
    try:
        print(failed.line, file=sys.stderr, flush=True)
        if terminal.json:
            print(text, flush=True)
    except OSError:  # nobody reads it, or it has no space: the exit code is what is left
        drop_output()


def _document(
    name: str,
    result: Document | None,
    findings: tuple[Finding, ...],
    ending: tuple[int, str],
    failed: Failure | None = None,
) -> str:
    from grainmotion.cli.json_output import document_text

    return document_text(name, result, findings, ending, failed)
