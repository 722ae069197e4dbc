"""What is drawn beside the grains in 3-D."""

from __future__ import annotations

from dataclasses import replace

import example
import numpy as np

from grainmotion.model.scene import Body
from grainmotion.model.state_fit import BodyMotion, StateFit
from grainmotion.model.volume import Volume
from grainmotion.report import ReportData
from grainmotion.report.body_surfaces import body_meshes
from grainmotion.report.scene_record import scene_record
from grainmotion.report.surfaces import mesh_record


def test_the_box_is_that_of_the_volume_and_bodies_move_with_their_states():
    plate = Body("upper piston", "piston", Volume(np.ones((2, 4, 6), np.float32), 0.5, (0.0, 0.0, 3.0)))
    dust = Body("rest", "rest", plate.volume)
    still = example.state("one")
    turned = BodyMotion(
        plate.name, plate.kind, "free", plate.center, np.array([0, 0, -0.2]), np.array([0, 0.1, 0]), np.eye(6), True
    )
    moved = replace(still, name="two", motions=replace(still.motions, fit=StateFit(bodies=(turned,))))
    volume = Volume(np.zeros((10, 8, 6), np.float32), 0.5, (1.0, 0.0, 0.0))
    record = scene_record(ReportData("x", volume=volume, bodies=(plate, dust), states=(still, moved)))
    assert record["box"] == [[-0.5, -2.0, -2.5], [2.5, 2.0, 2.5]]
    motions = [None, [0.0, 0.0, -0.2, 0.0, 0.1, 0.0]]
    assert record["bodies"] == [{"name": "upper piston", "center": [0.0, 0.0, 3.0], "motions": motions}]
    assert record["surfaces"] == mesh_record(body_meshes([plate]))


def test_a_report_without_a_volume_has_nothing_beside_the_grains():
    assert scene_record(ReportData("x")) == {"box": None, "bodies": [], "surfaces": None}
