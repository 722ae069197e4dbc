"""The 95 measured stones (`simulate.stone_shapes`), with the volumes of their source."""

import numpy as np
import pytest

from grainmotion.errors import InputError
from grainmotion.simulate import stone, stone_radius
from grainmotion.simulate.stone_shapes import read_stone_shapes

# volumes in mm³ from the source's table FDOT-57-geom.dat
VOLUMES = {
    "A-anm-00001": 3083.215147,
    "A-anm-00003": 1372.400276,
    "B-anm-00006": 2614.010153,
    "C-anm-00003": 4025.232063,
    "D-anm-00001": 1354.223554,
}


def test_there_are_95_stones():
    shapes = read_stone_shapes()
    assert len(shapes) == 95
    assert shapes.coefficients.shape == (95, 378)


@pytest.mark.parametrize("name", VOLUMES)
def test_stone_has_the_volume_of_the_source(name):
    index = read_stone_shapes().names.index(name)
    # V = ∫ r³/3 dΩ by Gauss-Legendre in cos θ and equal steps in φ
    nodes, weights = np.polynomial.legendre.leggauss(60)
    phi = np.arange(120) * 2 * np.pi / 120
    rho = np.sqrt(1 - nodes**2)
    directions = np.stack(
        [np.outer(rho, np.cos(phi)), np.outer(rho, np.sin(phi)), np.outer(nodes, np.ones(120))], axis=-1
    )
    r = stone_radius(index, directions.reshape(-1, 3)).reshape(60, 120)
    volume = (weights[:, None] * r**3 / 3).sum() * 2 * np.pi / 120
    assert volume == pytest.approx(VOLUMES[name], rel=5e-4)
    # the mesh is inscribed: a little less, and less so when finer
    assert 0 < volume / stone(index, level=4).volume - 1 < 8e-3


def test_unknown_stone_is_refused():
    with pytest.raises(InputError, match="0 to 94"):
        stone(95)
