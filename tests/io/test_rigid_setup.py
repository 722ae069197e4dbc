"""Source, panel and axis as vectors, and the circular scan that they make: the same rays through the sample."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from grainmotion.errors import InputError
from grainmotion.io.scanners.description import CircleNumbers, ScannerFile
from grainmotion.io.scanners.rigid_setup import RigidSetup, circle_numbers
from grainmotion.model.detector_alignment import DetectorAlignment
from grainmotion.model.geometry import Geometry

SHAPE, PIXEL = (5, 7), 0.3
ANGLES = np.array([0.0, 40.0, 200.0])


def setup_of(seed, *, flipped=(1, 1), quarter_turns=0):
    """A panel tilted about all axes, in a frame that is turned at random."""
    rng = np.random.default_rng(seed)
    frame = Rotation.random(random_state=seed).as_matrix()
    tilt = Rotation.from_euler("xyz", rng.uniform(-8, 8, 3), degrees=True).as_matrix()
    u, v = tilt @ [1, 0, 0], tilt @ [0, 0, -1]
    for _ in range(quarter_turns):
        u, v = v, -u
    source, center = np.array([1.5, -60, 2.0]), np.array([4.0, 180, -3.0])
    parts = source, center, flipped[0] * u, flipped[1] * v, np.array([0.0, 0, 1])
    return RigidSetup(*(frame @ p for p in parts)), frame


@pytest.mark.parametrize("flipped", [(1, 1), (-1, 1), (1, -1), (-1, -1)])
@pytest.mark.parametrize("quarter_turns", [0, 1, 3])
def test_rays_are_those_of_the_vectors(flipped, quarter_turns):
    setup, frame = setup_of(3, flipped=flipped, quarter_turns=quarter_turns)
    numbers, mirrored = circle_numbers("a.file", setup)
    panel = DetectorAlignment(
        detector_offset=numbers["detector_offset"],
        detector_tilts_deg=numbers["detector_tilts_deg"],
        axis_offset=numbers["axis_offset"],
        first_row=numbers["first_row"],
    )
    distances = {name: numbers[name] for name in ("source_to_axis", "source_to_detector")}
    geometry = Geometry.cone(ANGLES, SHAPE, PIXEL, **distances, panel=panel)
    geometry = ScannerFile(None, "", CircleNumbers(), mirrored=mirrored).placed(geometry)
    # in the frame of the setup's axis, from the source's height; it differs from ours by a turn about the axis
    told = np.stack([setup.source, setup.center, setup.u * PIXEL, setup.v * PIXEL]) @ frame
    told[:2, 2] -= (setup.source @ frame)[2]
    first = geometry.vectors[0].reshape(4, 3)
    offset = np.arctan2(*first[0, 1::-1]) - np.arctan2(*told[0, 1::-1])
    for view, angle in enumerate(ANGLES):
        turn = Rotation.from_rotvec([0, 0, offset + np.deg2rad(angle)]).as_matrix()
        np.testing.assert_allclose(geometry.vectors[view].reshape(4, 3), told @ turn.T, atol=1e-9)


def test_setups_that_cannot_be():
    setup, _ = setup_of(1)
    behind = RigidSetup(setup.source, setup.source * 0.9, setup.u, setup.v, setup.up)
    with pytest.raises(InputError, match=r"a\.file: the panel is .* mm from the source, and the axis"):
        circle_numbers("a.file", behind)
    with pytest.raises(InputError, match="the source lies on the rotation axis"):
        circle_numbers("a.file", RigidSetup(setup.up, setup.center, setup.u, setup.v, setup.up))
