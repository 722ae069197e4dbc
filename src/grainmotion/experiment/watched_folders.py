"""Folders that become states: those that match ``[watch] folders``, in the order of the numbers in their names."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from grainmotion.diagnosis.file_names import natural_order
from grainmotion.errors import InputError

FOLDER_MARK = "{folder}"
"""Stands in the table ``[watch]`` for the folder of the state."""


def matched_folders(pattern: str, base: Path, results: Path) -> list[Path]:
    """Folders that match a pattern, from ``base``; hidden ones and those within the results are left out."""
    if Path(pattern).is_absolute():
        anchor = Path(Path(pattern).anchor)
        base, pattern = anchor, str(Path(pattern).relative_to(anchor))
    try:
        results = results.resolve()
        found = [path for path in base.glob(pattern) if path.is_dir() and path.name[:1] != "."]
        usable = [path for path in found if not path.resolve().is_relative_to(results)]
    except (ValueError, NotImplementedError) as error:
        fact = f"'{pattern}' is no pattern ({error})"
        raise InputError("watch.folders", fact, 'give one such as "steps/*"') from error
    except OSError as error:
        fact = f"{base / pattern} cannot be read ({error.strerror})"
        raise InputError("watch.folders", fact, "change its permissions, or mount it again") from error
    return ordered_folders(usable)


def ordered_folders(folders: Iterable[Path]) -> list[Path]:
    """Folders in the order of the numbers in their names."""
    paths = list(folders)
    return [paths[k] for k in natural_order([f"{path}.tif" for path in paths])]


def with_folder(files: Sequence[str], folder: Path) -> list[str]:
    """Names of files with the folder of the state in place of `FOLDER_MARK`; it is found from any other folder."""
    return [name.replace(FOLDER_MARK, folder.absolute().as_posix()) for name in files]
