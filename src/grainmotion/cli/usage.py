"""Wrong use of options and arguments: one line that says what is wrong and what may have been meant."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

import typer

from grainmotion.cli.command import print_failure
from grainmotion.cli.exit_codes import BAD_INPUT
from grainmotion.cli.failures import Failure
from grainmotion.cli.parameters import NAME, Parameter, parameter_types, words_of
from grainmotion.cli.terminal import Terminal

UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Wrong use of options and arguments; typer has no public name for it."""
WANTED = {int: "a whole number", float: "a number"}
"""What an option of a type takes."""


def print_usage_error(error: Exception, args: Sequence[str]) -> int:
    """Tell about wrong use of options and arguments; returns the exit code."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError" and "--json" not in args:  # the help is the message
        print(getattr(error, "message", ""), file=sys.stderr)
        return BAD_INPUT
    path = context.command_path if context is not None else NAME
    command = path.removeprefix(NAME).strip() or NAME
    fact, _, remedy = _sentence(error, context, args).partition("; ")
    remedy = f"{remedy}; " if remedy else ""
    failed = Failure("usage", BAD_INPUT, "", fact, f"{remedy}see `{path} --help`")
    print_failure(failed, command, Terminal(json="--json" in args))
    return BAD_INPUT


def _sentence(error: Exception, context: object, args: Sequence[str]) -> str:
    """What is wrong, and after a semicolon what may have been meant."""
    kind, option = type(error).__name__, getattr(error, "option_name", None)
    if kind == "NoArgsIsHelpError":
        return "no command is named"
    if kind == "NoSuchOption" and option:
        file = next((word for word in args if word.startswith("-") and Path(word).exists()), None)
        if file is not None:
            return f"'{file}' is read as options; write the file's name as './{file}'"
        return _unknown_option(str(option), getattr(context, "command", None))
    parameter: Parameter | None = getattr(error, "param", None)
    if parameter is not None:
        taken = parameter_types(getattr(context, "command_path", NAME)).get(parameter.name, str)
        if kind == "MissingParameter" and words_of(taken):
            return f"missing option {_shown(parameter)}; it takes {', '.join(words_of(taken))}"
        if kind == "BadParameter":
            return _wrong_value(error, parameter, taken)
    text = error.format_message() if hasattr(error, "format_message") else str(error)
    return f"{text[:1].lower()}{text[1:]}".rstrip(".")


def _unknown_option(option: str, command: object) -> str:
    """The sentence about an option that a command does not have."""
    later = [name for name, inner in getattr(command, "commands", {}).items() if option in _options(inner)]
    if later:
        return f"no option '{option}' before the command; put it behind, as in grainmotion {later[0]} {option}"
    near = get_close_matches(option, _options(command), n=1, cutoff=0.5) if option.startswith("--") else []
    return f"no option '{option}'" + (f"; did you mean '{near[0]}'?" if near else "")


def _wrong_value(error: Exception, parameter: Parameter, kind: type) -> str:
    """The sentence about a value that an option does not take: what it takes, in the words of this program."""
    shown, message = _shown(parameter), str(getattr(error, "message", error)).rstrip(".")
    words = words_of(kind)
    if words:
        given = message.partition("'")[2].partition("'")[0]
        near = get_close_matches(given, words, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"it takes {', '.join(words)}"
        return f"'{given}' is no value of {shown}; {hint}"
    if kind in WANTED:
        least = re.search(r"(?:greater than or equal to |x>=)([\d.]+)", message)
        return f"wrong value of {shown}; give {WANTED[kind]}" + (f", {least[1]} or more" if least else "")
    return f"wrong value of {shown}: {message[:1].lower()}{message[1:]}"


def _shown(parameter: Parameter) -> str:
    """The name of an option or argument as users type it."""
    names = [name for name in parameter.opts if name.startswith("--")]
    return f"'{names[0]}'" if names else f"'{parameter.metavar or parameter.name}'"


def _options(command: object) -> list[str]:
    """The names of the options of a command."""
    parameters = getattr(command, "params", [])
    return [name for parameter in parameters for name in parameter.opts if name.startswith("-")]
