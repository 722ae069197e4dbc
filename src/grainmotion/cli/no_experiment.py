"""What to say where a command wants an experiment file and gets something else: the very command that helps."""

from __future__ import annotations

import shlex
import tomllib
from difflib import get_close_matches
from pathlib import Path

from grainmotion.cli.command import current_call
from grainmotion.errors import InputError

EXPERIMENT = "experiment.toml"
TABLES_OF_EXPERIMENTS = {"reference", "volume", "states", "watch"}


def check_experiment_file(file: Path) -> None:
    """Refuse what is no experiment file; mistakes inside one are for its reader."""
    if file.is_dir():
        raise InputError(str(file), "it is a folder, and no experiment file", _instead_of_folder(file))
    if not file.exists():
        raise InputError(str(file), "no such file", _instead_of_missing(file))
    try:
        tables = set(tomllib.loads(file.read_text(encoding="utf-8-sig")))
    except OSError:
        return  # its reader says what is wrong
    except (UnicodeDecodeError, tomllib.TOMLDecodeError):
        if file.suffix.lower() == ".toml":
            return
        raise InputError(str(file), f"it is {_kind(file)}, and no experiment file", _instead_of_data(file)) from None
    if not tables & TABLES_OF_EXPERIMENTS:
        fact = "it has none of the tables of an experiment file ([reference], [volume], [[states]])"
        raise InputError(str(file), fact, _init(file.parent))


def check_there(path: Path) -> None:
    """Refuse a path of the command line that leads nowhere, with the name that is most like it."""
    if path.exists():
        return
    folder = path.parent
    names = [item.name for item in folder.glob("*")] if folder.is_dir() else []
    near = get_close_matches(path.name, names, n=1)
    if near:
        remedy = f"did you mean {command(current_call().name, folder / near[0])}?"
    elif folder.is_dir():
        remedy = f"check the name; the folder {folder.absolute()} holds nothing of that name"
    else:
        remedy = f"there is no folder {folder} either; check the path"
    raise InputError(str(path), "no such file or folder", remedy)


def _kind(file: Path) -> str:
    """What a file is, by its name."""
    from grainmotion.io.formats import HDF5, family
    from grainmotion.io.scanners.identify import is_scanner_file
    from grainmotion.io.volumes.find import is_volume

    if is_volume(file):
        return "a volume"
    if is_scanner_file(file.name) and family(file) != HDF5:
        return "a scanner's file"
    return "images or another file of data" if family(file) is not None else "another file"


def experiment_near(file: Path) -> Path | None:
    """The experiment file beside a file of data, or in the folder above it: each scan may have a folder of its own."""
    folder = file.parent
    above = folder.parent if folder.name not in ("", "..") else folder.resolve().parent
    return next((path for path in (folder / EXPERIMENT, above / EXPERIMENT) if path.exists()), None)


def _instead_of_data(file: Path) -> str:
    """The command to type instead of one with a file of data."""
    near = experiment_near(file)
    if near is not None:
        return f"did you mean {command(current_call().name, near)}?"
    return f"{_init(file.parent)}; if each scan has a folder of its own, the folder above is the one to name"


def _instead_of_folder(folder: Path) -> str:
    """The command to type instead of one with a folder."""
    found = sorted(path for path in folder.glob("*.toml") if path.name != "pyproject.toml")
    if (folder / EXPERIMENT) in found:
        found = [folder / EXPERIMENT]
    if found:
        which = "the file" if len(found) == 1 else f"one of the {len(found)} files"
        return f"name {which} in it: {command(current_call().name, found[0])}"
    near = experiment_near(folder / EXPERIMENT)
    return _init(folder) if near is None else f"did you mean {command(current_call().name, near)}?"


def _instead_of_missing(file: Path) -> str:
    """The command to type instead of one with a file that is not there."""
    folder = file.parent
    names = [path.name for path in folder.glob("*.toml")] if folder.is_dir() else []
    near = get_close_matches(file.name, names, n=1)
    if near:
        return f"did you mean {command(current_call().name, folder / near[0])}?"
    if folder.is_dir():
        return _init(folder)
    return f"there is no folder {folder} either; check the path"


def _init(folder: Path) -> str:
    """How to make an experiment file."""
    then = command(current_call().name, folder / EXPERIMENT)
    if (folder / EXPERIMENT).exists():
        return f"did you mean {then}?"
    return f"make one from the folder of the measurements: {command('init', folder)}, then {then}"


def command(name: str, path: Path) -> str:
    """A command with a path, as a shell reads it."""
    return f"grainmotion {name} {shlex.quote(str(path))}"
