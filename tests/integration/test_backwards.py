"""From the end of a taught route the robot finds its way back to the start, in reverse: its camera looks as it did."""

import numpy as np

from tests.integration.whole_robot import state_is

SHORT_M = 12.0


def test_a_repeat_to_the_start_drives_the_route_in_reverse(robot):
    robot.calm()
    robot.forget_maps()
    start = robot.route[0]
    robot.put_down(*start)
    robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
    states = robot.states()
    robot.command("repeat", goal="start")
    robot.soon(lambda: state_is(states, "Repeat.Follow"), "the robot follows", 20.0)
    robot.soon(lambda: state_is(states, "Idle"), "the repeat ends", 90.0)
    assert states.last().message.reason.startswith("reached")
    x, y, yaw = robot.standing()
    assert np.hypot(x - start[0], y - start[1]) < 0.2
    assert abs(np.arctan2(np.sin(yaw - start[2]), np.cos(yaw - start[2]))) < 0.1
