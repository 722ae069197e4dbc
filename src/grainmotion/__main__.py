"""``python -m grainmotion``, and the entry point of the command ``grainmotion``.

Nothing but this module, `grainmotion.cli.interrupts` and `grainmotion.cli.streams` is imported before Ctrl-C and
SIGTERM are looked after, so that they end the first seconds of a command as cleanly as its hours.
"""

from __future__ import annotations

import sys
import warnings

from grainmotion.cli.interrupts import signals_end_the_command
from grainmotion.cli.streams import prepare_streams


def main() -> None:
    """Run the command line; ends the process with one of the exit codes of `grainmotion.cli.exit_codes`."""
    if sys.argv[0].endswith("__main__.py"):  # the log and the report tell the command
        sys.argv[0] = "grainmotion"
    warnings.simplefilter("ignore", FutureWarning)  # of libraries: users can do nothing about them
    with signals_end_the_command():
        prepare_streams()
        from grainmotion.cli.app import app

        app(prog_name="grainmotion")


if __name__ == "__main__":
    main()
