"""Options as ``--help`` shows them: flags take no value, and many words stand behind the meaning, not in a column."""

from __future__ import annotations

from typing import cast

import typer
from typer.core import TyperCommand

from grainmotion.cli.parameters import Parameter, parameter_types, words_of

MAX_WORDS_WIDTH = 40
"""Columns of the help that the words of an option get."""


def readable(parameters: object, context: typer.Context) -> list[Parameter]:
    """The parameters of a command, with the name of what they take where typer's own would be hard to read."""
    types, shown = parameter_types(_path(context)), cast(list[Parameter], parameters)
    for parameter in shown:
        if parameter.metavar is not None:
            continue
        words = words_of(types.get(parameter.name, str))
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        elif len("|".join(words)) > MAX_WORDS_WIDTH:
            parameter.metavar = f"<{parameter.name}>"
            parameter.help = f"{parameter.help}: {', '.join(words)}"
    return shown


def _path(context: object) -> str:
    """Program and command as they are typed; the library's own path asks for the parameters again."""
    names = []
    while context is not None:
        names.append(str(getattr(context, "info_name", "")))
        context = getattr(context, "parent", None)
    return " ".join(reversed(names))


class Command(TyperCommand):
    """A command with readable options."""

    def get_params(self, ctx: typer.Context) -> list[Parameter]:  # type: ignore[override]  # base is private
        """Options and arguments."""
        return readable(super().get_params(ctx), ctx)
