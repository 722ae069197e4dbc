"""The group of all commands: nearest names for mistyped ones, paths instead of a command, errors of usage."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

import typer
from typer.core import TyperGroup

from grainmotion.cli.command import print_failure
from grainmotion.cli.exit_codes import BAD_INPUT
from grainmotion.cli.failures import Failure
from grainmotion.cli.terminal import Terminal

UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Wrong use of options and arguments; typer has no public name for it."""
NAME, LOOK_COMMAND = "grainmotion", "inspect"
COMMAND_ORDER = (
    "demo", "inspect", "init", "run", "watch", "reconstruct", "segment", "track", "report", "view",
    "export", "plan", "simulate", "version",
)  # fmt: skip
"""Commands as the help lists them."""


class Suggesting(TyperGroup):
    """A group that names the nearest command for a mistyped one."""

    def parse_args(self, ctx: typer.Context, args: list[str]) -> list[str]:  # type: ignore[override]  # base is private
        """Arguments of the group, with a command in front where the first word stands for one."""
        word = args[0] if args else ""
        if word and word not in self.commands and word not in ctx.help_option_names:
            command = self.meant_by(word)
            if command is not None:
                args = [command, *args]
            elif not word.startswith("-") and not ctx.resilient_parsing:
                ctx.fail(self.unknown(word))
        return super().parse_args(ctx, args)

    def meant_by(self, word: str) -> str | None:
        """The command that is meant where a word stands that is none; None if there is no such command."""
        return None

    def unknown(self, word: str) -> str:
        """The sentence about a command that does not exist."""
        near = get_close_matches(word, list(self.commands), n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"there are {', '.join(self.commands)}"
        return f"no command '{word}'; {hint}"


class Program(Suggesting):
    """All commands; a file or folder instead of a command is inspected."""

    def meant_by(self, word: str) -> str | None:
        """`inspect` for a file or folder."""
        return LOOK_COMMAND if not word.startswith("-") and Path(word).exists() else None

    def unknown(self, word: str) -> str:
        """The sentence about what is neither a command nor a file."""
        if "/" in word or "\\" in word or Path(word).suffix:
            return f"no file or folder '{word}', and no command of that name; check the path"
        return super().unknown(word)

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]  # base is private
        """Names of the commands, in the order of the panels of the help."""
        known = [name for name in COMMAND_ORDER if name in self.commands]
        return known + [name for name in self.commands if name not in COMMAND_ORDER]

    def main(  # type: ignore[override]  # of its further keywords none is used
        self,
        args: Sequence[str] | None = None,
        prog_name: str | None = None,
        complete_var: str | None = None,
        standalone_mode: bool = True,
        windows_expand_args: bool = True,
    ) -> object:
        """Run the command that the arguments name, and end the process with its exit code."""
        wanted = list(sys.argv[1:] if args is None else args)
        if not standalone_mode:
            return super().main(wanted, NAME, complete_var, False, windows_expand_args)
        try:
            code = super().main(wanted, NAME, complete_var, False, windows_expand_args)
        except UsageError as error:
            sys.exit(_told(error, wanted))
        sys.exit(code if isinstance(code, int) else 0)


def _told(error: Exception, args: Sequence[str]) -> int:
    """Tell about wrong use of options and arguments; returns the exit code."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":  # the help is the message
        print(getattr(error, "message", ""), file=sys.stderr)
        return BAD_INPUT
    path = context.command_path if context is not None else NAME
    command = path.removeprefix(NAME).strip() or "grainmotion"
    fact, _, remedy = _sentence(error, context).partition("; ")
    remedy = f"{remedy}; " if remedy else ""
    failed = Failure("usage", BAD_INPUT, "", fact, f"{remedy}see `{path} --help`")
    print_failure(failed, command, Terminal(json="--json" in args))
    return BAD_INPUT


def _sentence(error: Exception, context: object) -> str:
    """What is wrong, and after a semicolon what may have been meant."""
    option = getattr(error, "option_name", None)
    if type(error).__name__ == "NoSuchOption" and option:
        command = getattr(context, "command", None)
        later = [name for name, inner in getattr(command, "commands", {}).items() if option in _options(inner)]
        if later:
            return f"no option '{option}' before the command; put it behind, as in grainmotion {later[0]} {option}"
        near = get_close_matches(option, _options(command), n=1, cutoff=0.5)
        return f"no option '{option}'" + (f"; did you mean '{near[0]}'?" if near else "")
    text = error.format_message() if hasattr(error, "format_message") else str(error)
    return f"{text[:1].lower()}{text[1:]}".rstrip(".")


def _options(command: object) -> list[str]:
    """The names of the options of a command."""
    parameters = getattr(command, "params", [])
    return [name for parameter in parameters for name in parameter.opts if name.startswith("-")]
