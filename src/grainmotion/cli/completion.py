"""What the shell's Tab offers for an experiment file: TOML files; where there are none it completes paths itself."""

from __future__ import annotations

import os

TOML = ".toml"


def complete_experiment(incomplete: str) -> list[str]:
    """TOML files whose path begins with what is typed.

    Names with spaces are left to the shell, which knows how to quote them; so are folders on the way.
    """
    folder, name = os.path.split(incomplete)
    try:
        names = sorted(os.listdir(folder or os.curdir))
    except OSError:
        return []
    found = [n for n in names if n.startswith(name) and n.endswith(TOML) and (name or not n.startswith("."))]
    if any(" " in n for n in found):
        return []
    return [os.path.join(folder, n) for n in found if n != "pyproject.toml"]
