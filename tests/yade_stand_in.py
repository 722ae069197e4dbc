"""What the example of the documentation takes from YADE, without YADE: vectors, quaternions, spheres and clumps."""

from __future__ import annotations

import types
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation


class Quaternion:
    """A rotation by w, x, y, z, as YADE orders them; its product with a vector rotates the vector."""

    def __init__(self, w: float, x: float, y: float, z: float) -> None:
        self.rotation = Rotation.from_quat([x, y, z, w])

    def __mul__(self, vector: np.ndarray) -> np.ndarray:
        return self.rotation.apply(vector)


class Bodies:
    """The bodies of a simulation; of clumps the centres and radii of their spheres are kept, metres."""

    def __init__(self) -> None:
        self.clumps: list[np.ndarray] = []

    def appendClumped(self, spheres: list[types.SimpleNamespace]) -> None:  # noqa: N802  # YADE's name
        self.clumps.append(np.array([[*s.state.pos, s.radius] for s in spheres]))

    def centers(self) -> np.ndarray:
        """Means of the centres of each clump's spheres, weighted by their volumes."""
        return np.array([np.average(c[:, :3], axis=0, weights=c[:, 3] ** 3) for c in self.clumps])


def text_ext(path: str, format: str, scale: float) -> list[types.SimpleNamespace]:
    """`yade.ymport.textExt`: spheres from lines of x y z r; lines that begin with # are left out."""
    assert format == "x_y_z_r"
    lines = [line.split() for line in Path(path).read_text().splitlines() if not line.startswith("#")]
    numbers = [scale * np.array(line, dtype=float) for line in lines]
    return [types.SimpleNamespace(state=types.SimpleNamespace(pos=n[:3]), radius=n[3]) for n in numbers]


def names_of_yade() -> dict[str, object]:
    """Names that a script has when YADE runs it."""
    return {
        "O": types.SimpleNamespace(bodies=Bodies()),
        "Vector3": lambda *numbers: np.array(numbers),
        "Quaternion": Quaternion,
    }


def yade_module() -> types.ModuleType:
    """The module `yade`."""
    module = types.ModuleType("yade")
    module.ymport = types.SimpleNamespace(textExt=text_ext)  # type: ignore[attr-defined]
    return module
