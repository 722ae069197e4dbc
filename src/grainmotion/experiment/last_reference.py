"""What the segmented reference of an earlier run holds, in sentences."""

from __future__ import annotations

from pathlib import Path

from grainmotion.analysis.scene_parts import field_sentence, scene_parts
from grainmotion.errors import InputError
from grainmotion.io.results import StoredReference, read_reference


def last_reference(path: Path) -> tuple[str, ...]:
    """What attenuates in a ``reference.h5``; empty without such a file; what is wrong with it if it is damaged."""
    if not path.is_file():
        return ()
    try:
        return described(read_reference(path))
    except InputError as error:
        return (str(error),)


def described(reference: StoredReference) -> tuple[str, ...]:
    """Grains, bodies, liquid and the rest with their shares of the attenuation, and what lies beyond the field."""
    if reference.labels is None or reference.scene is None:
        return ()
    parts = scene_parts(reference.volume, reference.labels, reference.scene, reference.border)
    beyond = field_sentence(reference.scene)
    return (*map(str, parts), *([beyond] if beyond else []))
