"""The group of all commands: nearest names for mistyped ones, paths instead of a command, how the process ends."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path

import typer
from typer.core import TyperGroup

from grainmotion.cli.command import print_failure
from grainmotion.cli.exit_codes import OUTPUT_CLOSED
from grainmotion.cli.failures import failure
from grainmotion.cli.help_options import readable
from grainmotion.cli.interrupts import Stop
from grainmotion.cli.parameters import NAME, Parameter
from grainmotion.cli.streams import drop_output
from grainmotion.cli.terminal import Terminal
from grainmotion.cli.usage import UsageError, print_usage_error

LOOK_COMMAND = "inspect"
COMMAND_ORDER = (
    "demo", "inspect", "init", "run", "watch", "reconstruct", "segment", "track", "report", "view",
    "export", "plan", "simulate", "version",
)  # fmt: skip
"""Commands as the help lists them."""


class Suggesting(TyperGroup):
    """A group that names the nearest command for a mistyped one."""

    def get_params(self, ctx: typer.Context) -> list[Parameter]:  # type: ignore[override]  # base is private
        """Options of the group."""
        return readable(super().get_params(ctx), ctx)

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
            sys.exit(print_usage_error(error, wanted))
        except SystemExit as end:
            if isinstance(end.__context__, BrokenPipeError):  # as of `--help | head`
                sys.exit(OUTPUT_CLOSED)
            raise
        except OSError as error:  # as of `--help > file` on a full disk
            failed = failure(error, Stop())
            print_failure(failed, NAME, Terminal())
            drop_output()
            sys.exit(failed.code)
        sys.exit(code if isinstance(code, int) else 0)
