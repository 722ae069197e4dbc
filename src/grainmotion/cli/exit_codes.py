"""Exit codes of the command line, one list for `--help`, the documentation and JSON documents."""

from __future__ import annotations

from types import MappingProxyType

SUCCESS = 0
FAULT = 1
"""Out of memory, or a fault of the program."""
BAD_INPUT = 2
"""An input or an option cannot be used."""
NO_RESULT = 3
"""No grain of some state is usable, or there is a warning and ``--strict`` is given."""
INTERRUPTED_BY_USER = 130
OUTPUT_CLOSED = 141
"""As shells tell of programs that SIGPIPE ended."""
TERMINATED = 143

EXIT_CODES = MappingProxyType({
    SUCCESS: "success",
    FAULT: "out of memory, or a fault of the program",
    BAD_INPUT: "an input or an option cannot be used",
    NO_RESULT: "no grain of some state is usable, or --strict is given and there is a warning",
    INTERRUPTED_BY_USER: "interrupted by Ctrl-C; the same command continues",
    OUTPUT_CLOSED: "the program that read the output has ended, as `head` does; the same command continues",
    TERMINATED: "ended by SIGTERM, as batch systems send it; the same command continues",
})  # fmt: skip
EPILOG = "Exit codes: " + "; ".join(f"{code} {meaning.split(';')[0]}" for code, meaning in EXIT_CODES.items()) + "."
