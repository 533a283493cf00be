"""Replay of taught actions against a simulated unicycle, with a simulated bearing sensor."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from common.geometry import from_xy_yaw, inverse, yaw_of
from services.tracker.limits import Drive, LimitError, Limits
from services.tracker.path import RouteError
from services.tracker.predict import arc
from services.tracker.replay import ActionReplay, Motion, ReplaySettings
from services.tracker.speed import CautionSettings
from services.tracker.taught import TaughtWay, action_at

DT = 0.05
LIMITS = Limits()
CERTAIN = np.diag([0.05, 1.0, 0.05, 0.05, 0.05, 0.02]) ** 2
AT_FRAME = Motion(np.eye(4), np.eye(4), 0.5, 0.0)


@dataclass
class Lesson:
    """A taught drive: commands (K, 3) ``[metres, v, w]``, poses (K, 4, 4), and every eighth of them as vertices."""

    actions: np.ndarray
    poses: np.ndarray

    @property
    def vertices(self):
        return np.concatenate([self.poses[::8], self.poses[-1:]])


def teach(commands):
    """Drives commands (v, w), DT seconds each, by an ideal unicycle."""
    T, s, actions, poses = np.eye(4), 0.0, [], []
    for v, w in commands:
        actions.append((s, v, w))
        poses.append(T)
        T, s = T @ arc(v, w, DT), s + abs(v) * DT
    return Lesson(np.array(actions), np.array([*poses, T]))


def winding(seconds=60.0, speed=0.8):
    """Left and right bends, from standstill to standstill."""
    t = np.arange(0.0, seconds, DT)
    v = speed * np.clip(np.minimum(t / 2.0, (seconds - t) / 2.0), 0.15, 1.0)
    return teach(list(zip(v, v * 0.25 * np.sin(t / 4.0), strict=True)))


def replayer(lesson, **settings):
    replay = ActionReplay(LIMITS, CautionSettings(), ReplaySettings(**settings))
    replay.set_route(lesson.vertices)
    return replay


def nearest(lesson, T, at):
    """Index of the taught pose nearest to a robot, searched near the last one, and its place to the left of it."""
    first, last = max(at - 40, 0), min(at + 40, len(lesson.poses))
    at = first + int(np.argmin(np.linalg.norm(lesson.poses[first:last, :2, 3] - T[:2, 3], axis=1)))
    return at, float((inverse(lesson.poses[at]) @ T)[1, 3])


def repeat(lesson, start, *, depth=6.0, noise=0.0, seconds=120.0, speed_limits=(), **settings):
    """Commands (N, 2), lateral offsets (N,) and the last output of a repeat by one who sees bearings alone."""
    way, replay = TaughtWay(lesson.vertices), replayer(lesson, **settings)
    replay.set_route(lesson.vertices, speed_limits)
    rng = np.random.default_rng(0)
    taught = np.concatenate([lesson.actions[:, 0], [way.length]])
    T, at, commands, lateral, output = start, 0, [], [], None
    for _ in range(round(seconds / DT)):
        at, left = nearest(lesson, T, at)
        seen = float(yaw_of(inverse(lesson.poses[at]) @ T)) + math.atan2(left, depth) + noise * rng.standard_normal()
        metres = min(taught[at], way.length)
        trunk = int(np.argmin(np.abs(way.metres - metres)))
        turn = float(np.interp(metres, way.metres, way.yaw) - way.yaw[trunk])
        T_trunk_robot = from_xy_yaw(metres - way.metres[trunk], 0.0, turn + seen)
        near = lesson.actions[np.abs(lesson.actions[:, 0] - metres) < 2.0] - [metres, 0.0, 0.0]
        v, w = commands[-1] if commands else (0.0, 0.0)
        motion = Motion(np.eye(4), np.eye(4), v, w)
        output = replay.update(trunk, T_trunk_robot, CERTAIN, near, motion, 0.0, 0.0, DT)
        commands.append((output.v, output.w))
        lateral.append(left)
        if output.finished:
            break
        T = T @ arc(output.v, output.w, DT)
    return np.array(commands), np.array(lateral), output


def test_from_the_taught_start_it_drives_the_taught_commands():
    lesson = winding()
    commands, lateral, output = repeat(lesson, np.eye(4))
    assert output.finished
    assert np.abs(lateral).max() < 0.05
    driven = np.cumsum(np.abs(commands[:, 0])) * DT
    cruising = (driven > 3.0) & (driven < lesson.actions[-1, 0] - 3.0)
    expected = np.interp(driven[cruising], lesson.actions[:, 0], lesson.actions[:, 2])
    assert np.sqrt(np.mean((commands[cruising, 1] - expected) ** 2)) < 0.03
    np.testing.assert_allclose(commands[cruising, 0], 0.8, atol=0.05)


@pytest.mark.parametrize("offset", [0.5, -0.5])
@pytest.mark.parametrize("heading", [0.1, -0.1])
def test_it_converges_from_beside_the_start(offset, heading):
    lesson = winding()
    _, lateral, output = repeat(lesson, from_xy_yaw(0.0, offset, heading), noise=math.radians(0.5))
    assert output.finished
    assert np.abs(lateral).max() < 0.7
    assert np.abs(lateral[-200:]).max() < 0.1
    assert np.abs(lateral[400:]).max() < 0.25


def test_it_converges_faster_the_nearer_the_scene():
    lesson = winding()
    ends = [abs(repeat(lesson, from_xy_yaw(0.0, 0.5, 0.0), depth=depth)[1][250]) for depth in (3.0, 6.0, 15.0)]
    assert ends == sorted(ends)


def test_limits_hold_whatever_was_taught():
    lesson = teach([(3.0, 2.5)] * 100)
    commands, _, _ = repeat(lesson, from_xy_yaw(0.0, 0.3, 0.3), seconds=5.0)
    assert np.abs(commands[:, 0]).max() <= LIMITS.speed + 1e-9
    assert np.abs(commands[:, 1]).max() <= LIMITS.turn_rate + 1e-9
    steps = np.abs(np.diff(np.concatenate([[[0.0, 0.0]], commands]), axis=0)) / DT
    assert (steps <= np.array([max(LIMITS.acceleration, LIMITS.deceleration), LIMITS.turn_acceleration]) + 1e-6).all()


def test_it_slows_down_where_the_localization_is_poor():
    lesson = winding()
    actions = lesson.actions[:200] - [lesson.actions[100, 0], 0.0, 0.0]
    speeds = []
    for metres, sigma in ((0.0, 0.05), (6.0, 0.05), (0.0, 1.1)):
        replay = replayer(lesson)
        replay.reset_command(0.8, 0.0)
        covariance = np.diag([sigma, 1.0, 1, 1, 1, 0.02]) ** 2
        for _ in range(40):
            output = replay.update(5, np.eye(4), covariance, actions, AT_FRAME, metres, 0.0, DT)
        speeds.append(output.v)
    assert speeds[0] > 1.5 * speeds[1]
    assert speeds[0] > 1.5 * speeds[2]
    assert min(speeds) > 0.0


def test_a_place_is_moved_on_by_the_wheels_against_the_taught_turn():
    lesson = winding()
    way = TaughtWay(lesson.vertices)
    k, ahead = 24, 10
    metres, offset = way.place(3, np.eye(4))
    assert (metres, offset) == (pytest.approx(way.metres[3]), pytest.approx(0.0))
    T = inverse(lesson.poses[k]) @ lesson.poses[k + ahead]
    later, offset = way.moved(metres, offset, T, 1.0)
    assert later == pytest.approx(lesson.actions[k + ahead, 0], abs=0.01)
    assert offset == pytest.approx(0.0, abs=0.01)


def test_a_heading_far_off_is_turned_back_on_the_spot():
    lesson = winding()
    _, lateral, output = repeat(lesson, from_xy_yaw(0.0, 0.0, 1.5))
    assert output.finished
    assert np.abs(lateral).max() < 0.4
    replay = ActionReplay(Limits(drive=Drive.ACKERMANN, curvature=0.5), CautionSettings())
    replay.set_route(lesson.vertices)
    for _ in range(20):
        output = replay.update(5, from_xy_yaw(0.0, 0.0, 1.5), CERTAIN, lesson.actions[:200], AT_FRAME, 0.0, 0.0, DT)
    assert output.v > 0.0
    assert abs(output.w) <= 0.5 * output.v + 1e-9


def test_what_was_taught_backwards_is_driven_backwards():
    lesson = teach([(-0.4, 0.1)] * 200)
    commands, lateral, output = repeat(lesson, np.eye(4), seconds=60.0)
    assert output.finished
    assert commands[20:-20, 0].max() < 0.0
    assert np.abs(lateral).max() < 0.1


def test_the_taught_speed_is_lowered_to_the_limit_of_a_stretch_and_the_curve_stays():
    lesson = winding()
    metres = TaughtWay(lesson.vertices).metres
    limits = np.where((metres >= 12.0) & (metres < 20.0), 0.3, 1000.0)
    begin, end = metres[limits < 1.0][0], metres[np.flatnonzero(limits < 1.0)[-1] + 1]
    commands, lateral, output = repeat(lesson, np.eye(4), speed_limits=limits)
    driven = (np.cumsum(np.abs(commands[:, 0])) - np.abs(commands[:, 0])) * DT
    # The place is known to the distance between two taught poses.
    slow = (driven > begin) & (driven < end - 0.05)
    assert output.finished
    assert commands[slow, 0].max() <= 0.3 + 1e-9
    assert commands[driven < begin - 2.0, 0].max() == pytest.approx(0.8)
    assert commands[driven > end + 2.0, 0].max() == pytest.approx(0.8)
    assert np.abs(np.diff(commands[:, 0])).max() <= LIMITS.deceleration * DT + 1e-9
    assert np.abs(lateral).max() < 0.1


def test_limits_that_are_not_one_a_vertex_are_refused():
    lesson = winding()
    with pytest.raises(LimitError):
        replayer(lesson).set_route(lesson.vertices, [0.3])


def test_taught_stops_are_not_repeated():
    actions = np.array([[-0.5, 0.8, 0.2], [0.0, 0.0, 0.0], [0.5, 0.8, 0.2]])
    found = action_at(actions, 0.0, 0.03)
    assert (found.v, found.curvature) == (pytest.approx(0.8), pytest.approx(0.25))
    assert action_at(actions[1:2], 0.0, 0.03) is None
    assert action_at(np.zeros((0, 3)), 0.0, 0.03) is None


def test_without_an_action_it_stands_and_says_so():
    lesson = winding()
    replay = replayer(lesson)
    output = replay.update(5, np.eye(4), CERTAIN, np.zeros((0, 3)), AT_FRAME, 0.0, 0.0, DT)
    assert (output.v, output.w) == (0.0, 0.0)
    assert "no taught action" in output.reason
    assert not output.finished


def test_a_vertex_that_the_route_has_not_is_refused():
    with pytest.raises(RouteError, match="999"):
        replayer(winding()).update(999, np.eye(4), CERTAIN, np.zeros((0, 3)), AT_FRAME, 0.0, 0.0, DT)
