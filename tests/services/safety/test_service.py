"""Safety as a process: its rate, what it lets through, and what ends neither it nor its stops."""

import subprocess
import sys
import time

import pytest

from common import topics
from common.messages import Joystick, StateName, now_ns
from tests.processes import Robot, every
from tests.services.safety.crew import Crew

S = StateName


@pytest.fixture(scope="module")
def crew(tmp_path_factory):
    with Robot(tmp_path_factory.mktemp("robot"), "[safety]\nestop_button = 2\n") as robot:
        crew = Crew(robot)
        robot.start("safety")
        with every(0.03, crew.publish):
            yield crew


def test_it_commands_at_its_rate_even_to_stand(crew):
    crew.until(lambda safe: safe.v == 0.0, "the first command")
    count, begin = 0, time.monotonic()
    while count < 50:
        received = crew.safe.wait(5.0)
        assert received is not None
        assert (received.message.v, received.message.w, received.message.frame_stamp) == (0.0, 0.0, 0)
        count += 1
    assert 20 < count / (time.monotonic() - begin) < 60
    _, rules = crew.until_status(lambda status: not status.passing, "a status")
    assert rules == {"state_forbids"}


def test_the_trackers_command_passes_while_following_and_names_its_frame(crew):
    with crew.state_is(S.REPEAT_FOLLOW):
        safe = crew.until(lambda safe: safe.v == pytest.approx(0.4) and safe.w == pytest.approx(0.1), "full speed")
        assert safe.frame_stamp == 77
        crew.until_status(lambda status: status.passing and status.scale == 1.0, "a status that says so")


def test_the_operators_command_passes_while_a_map_is_taught(crew):
    with crew.state_is(S.TEACH_BRANCH):
        assert crew.until(lambda safe: safe.v == pytest.approx(-0.4), "the operator drives").frame_stamp == 0


@pytest.mark.parametrize("state", [S.PAUSED, S.REPEAT_PLAN, S.REPEAT_METRIC_LOCALIZE])
def test_nothing_passes_in_other_states(crew, state):
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        crew.state_name = state
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")


def test_odometry_of_frames_of_before_is_old_however_often_it_comes(crew):
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        crew.lags = True
        try:
            crew.until(lambda safe: safe.v == 0.0, "the robot stands")
            _, rules = crew.until_status(lambda status: not status.passing, "a status")
        finally:
            crew.lags = False
        assert rules == {"odometry_stale"}
        crew.until(lambda safe: safe.v > 0.3, "the robot drives again")


def test_a_killed_estimator_stops_the_robot_by_name(crew):
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        crew.robot.kill("estimator")
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
        status, _ = crew.until_status(lambda status: not status.passing, "a status that says so")
        assert any("estimator" in reason.text for reason in status.reasons)
        crew.robot.stand_in("estimator")
        crew.until(lambda safe: safe.v > 0.3, "the robot drives again")


def test_an_emergency_stop_is_latched_beyond_the_death_of_safety_until_it_is_reset(crew):
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        crew.command("stop", "a child on the path")
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
        crew.robot.kill("safety")
        killed = now_ns()
        crew.robot.start("safety")
        status, rules = crew.until_status(
            lambda status: status.stamp > killed and status.latched, "it is latched still"
        )
        assert "emergency_stop" in rules
        assert any("a child on the path" in reason.text for reason in status.reasons)
        crew.speed = crew.turn = 0.0
        crew.command("reset")
        crew.until_status(lambda status: status.passing, "it is reset")
        crew.speed, crew.turn = 0.4, 0.1
        crew.until(lambda safe: safe.v > 0.3, "the robot drives again")


def test_nonsense_on_its_topics_moves_nothing(crew):
    session = crew.tracker.session
    for topic in (topics.DESIRED, topics.STATE, topics.LOCALIZATION, topics.TELEOP, topics.SAFETY_COMMAND):
        for payload in (b"", b"VTR1", bytes(64), b"\xff" * 300):
            session.put(topic.at("r1"), payload)
            session.put(topic.at("r1"), payload, attachment=payload)
    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "it passes what is sound")
    assert crew.robot.alive("safety")


def test_a_button_of_the_joystick_latches_the_emergency_stop(crew):
    stick = crew.operator.publisher(topics.JOYSTICK)

    def press(pressed):
        stick.put(Joystick(stamp=now_ns(), axes=[], held=False, buttons=[False, False, pressed]))

    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        press(pressed=True)
        status, rules = crew.until_status(lambda status: status.latched, "it is latched")
        assert "emergency_stop" in rules
        assert any("the joystick's button" in reason.text for reason in status.reasons)
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
        press(pressed=False)
        crew.command("reset")
        status, _ = crew.until_status(lambda status: not status.latched, "it is reset")
        assert crew.safe.last().message.v == 0.0


def test_another_machine_latches_the_emergency_stop(crew, tmp_path):
    """A file that holds no more than where the robot's router is, and the command line."""
    config = tmp_path / "elsewhere.toml"
    robot = f'[robot]\nname = "{crew.robot.name}"\ndirectory = "{tmp_path}"\n'
    config.write_text(f'{robot}[bus]\nendpoint = "{crew.robot.endpoint}"\nshared_memory = false\n', encoding="utf-8")

    def estop(*options):
        subprocess.run([sys.executable, "-m", "cli", "estop", "--config", config, *options], check=True, cwd=tmp_path)

    with crew.state_is(S.REPEAT_FOLLOW):
        crew.until(lambda safe: safe.v > 0.3, "the robot drives")
        estop()
        crew.until_status(lambda status: status.latched, "it is latched")
        crew.until(lambda safe: safe.v == safe.w == 0.0, "the robot stands")
        estop("--reset")
        crew.until_status(lambda status: not status.latched, "it is reset")
        assert crew.safe.last().message.v == 0.0
