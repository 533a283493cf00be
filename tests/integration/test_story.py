"""Teach a route by hand and let the robot repeat it, on nothing but what it sees."""

import numpy as np

from cli.demo.errors import path_errors
from cli.demo.story import Offset
from common.ids import VertexId

SHORT_M = 16.0


def test_teach_and_repeat(robot):
    robot.calm()
    robot.put_down(*robot.route[0])
    robot.forget_maps()
    map_id, taught = robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
    assert taught.driven_metres() > SHORT_M - 1.0
    repeated = robot.story.repeat(taught.poses()[0], Offset(), taught.driven_metres(), 120.0, VertexId(map_id, 0))
    assert repeated.final_state == "Idle"
    assert repeated.final_reason.startswith("reached")
    errors = path_errors(taught.poses(), repeated.poses())
    settled = np.abs(errors.after(5.0).lateral)
    assert np.sqrt(np.mean(settled**2)) <= 0.05
    assert settled.max() <= 0.20
    assert abs(errors.lateral[0] - 0.3) < 0.05
    assert np.linalg.norm(repeated.poses()[-1][:3, 3] - taught.poses()[-1][:3, 3]) <= 0.15
    assert repeated.localization_figures()["success"] > 0.95
    robot.soon(lambda: robot.speed() < 0.01, "the robot stands")
