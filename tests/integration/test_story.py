"""Teach a route by hand and let the robot repeat it, on nothing but what it sees."""

import numpy as np

from cli.demo.errors import path_errors
from cli.demo.story import Offset
from tests.integration.whole_robot import state_is

SHORT_M = 20.0


def test_teach_and_repeat(robot):
    robot.calm()
    robot.put_down(*robot.route[0])
    robot.forget_maps()
    map_id, taught = robot.story.teach(robot.first_metres(SHORT_M), robot.pace)
    assert taught.driven_metres() > SHORT_M - 1.0
    repeated = robot.story.repeat(map_id, taught.poses()[0], Offset(), timeout=120.0)
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


def test_a_second_route_branches_off_the_first_and_a_repeat_drives_both(robot):
    robot.calm()
    first = robot.taught()[0]
    states = robot.states()
    robot.command("teach")
    robot.soon(lambda: state_is(states, "Teach.Branch"), "the robot has localized and branches off", 20.0)
    human = robot.drive_by_hand(robot.metres_from(SHORT_M, 8.0))
    assert human.arrived.wait(60)
    robot.soon(lambda: robot.speed() < 0.01, "the robot stands")
    robot.command("finish", end_place="far", timeout=30.0)
    human.stop()
    assert len(robot.taught()) == 2
    start = robot.route[0]
    robot.put_down(*start)
    robot.command("repeat", goal="far", vertex=(first, 0))
    robot.soon(lambda: state_is(states, "Repeat.Follow"), "the robot follows", 20.0)
    robot.soon(lambda: state_is(states, "Idle"), "the repeat ends", 90.0)
    assert states.last().message.reason.startswith("reached")
    end = robot.metres_from(SHORT_M, 8.0)[-1]
    assert np.linalg.norm(robot.standing()[:2] - end[:2]) < 0.3
