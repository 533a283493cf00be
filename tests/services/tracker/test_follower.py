import math

import numpy as np
import pytest

from common.geometry import from_xy_yaw
from services.tracker.follower import FollowerSettings, NoRouteError, PathFollower
from services.tracker.limits import Drive, LimitError, Limits
from services.tracker.path import make_path
from services.tracker.simulation import World, drive, lay_route, true_errors

KNOWN = 1e-4 * np.eye(6)
OFFSET = from_xy_yaw(0.0, 0.3, math.radians(5.0))


def repeat(pieces, poses, start=OFFSET, follower_settings=None, metres=0.0, speed_limits=(), **world):
    """Drive a route of which `poses` were taught; returns the run and all outputs of the tracker."""
    follower, outputs = PathFollower(follower_settings), []
    follower.set_route(poses, speed_limits)

    def control(trunk, T_trunk_robot, v, w, dt):
        outputs.append(follower.update(trunk, T_trunk_robot, KNOWN, v, w, metres, 0.0, dt))
        return outputs[-1].v, outputs[-1].w, outputs[-1].finished

    run = drive(control, lay_route(pieces, 0.4), start, World(longest=150.0, **world))
    return run, outputs


def distance_to_end(run, pieces):
    return float(np.linalg.norm(run.pose[-1, :2] - lay_route(pieces, 0.4)[-1, :2, 3]))


@pytest.mark.parametrize("seed", [1, 2])
def test_follows_a_curved_route_from_a_start_beside_it(curves, taught, seed):
    run, outputs = repeat(curves, taught(curves), seed=seed)
    along, lateral = true_errors(run.pose, lay_route(curves, 0.02))
    converged = lateral[along > 5.0]
    assert run.finished
    assert np.sqrt(np.mean(converged**2)) <= 0.03
    assert np.abs(converged).max() <= 0.20
    assert distance_to_end(run, curves) <= 0.10
    assert 60.0 / (len(run.pose) * 0.05) >= 1.0
    assert {output.reason for output in outputs} <= {"", "stopping at the end", "at the end"}


def test_drives_backwards_where_the_route_was_taught_so(taught):
    pieces = [(-6, 0), (-6, 1.5), (-4, -0.8)]
    run, outputs = repeat(pieces, taught(pieces))
    along, lateral = true_errors(run.pose, lay_route(pieces, 0.02))
    assert run.finished
    assert max(output.v for output in outputs) <= 0.0
    assert np.sqrt(np.mean(lateral[along > 5.0] ** 2)) <= 0.03
    assert distance_to_end(run, pieces) <= 0.10


@pytest.mark.parametrize(
    "pieces",
    [[(8, 0), (4, 0.8), (-6, 0.8), (5, 0)], [(6, 0), (0, 1.6), (6, 0), (0, -3.0), (4, 0)]],
    ids=["cusps", "turns on the spot"],
)
def test_manoeuvres_as_taught(taught, pieces):
    run, _ = repeat(pieces, taught(pieces))
    dense = lay_route(pieces, 0.05)[:, :2, 3]
    late = run.pose[np.linalg.norm(run.pose[:, :2] - dense[0], axis=1).argmax() :]
    off = [np.linalg.norm(dense - [x, y], axis=1).min() for x, y, _ in late]
    assert run.finished
    assert max(off) <= 0.12
    assert distance_to_end(run, pieces) <= 0.10


@pytest.mark.parametrize("seed", range(12))
def test_drives_across_a_joint_of_two_maps_without_stopping(seed):
    rng = np.random.default_rng(seed)
    joint = from_xy_yaw(*rng.uniform([-0.15, -0.05, -0.06], [0.15, 0.05, 0.06]))
    pieces = [(4, 0), (4, 0.4), (4, 0)]
    first, second = lay_route(pieces[:1], 0.4), lay_route(pieces[1:], 0.4)
    run, outputs = repeat(pieces, np.concatenate([first, first[-1] @ joint @ second]), start=np.eye(4), seed=seed)
    assert run.finished
    middle = [output.v for output in outputs if 2.0 < output.arclength < 8.0]
    assert min(middle) > 0.6


def test_a_car_keeps_to_its_curvature(taught):
    pieces = [(8, 0), (9, 9 / 4), (6, 0)]
    limits = Limits(drive=Drive.ACKERMANN, curvature=0.35)
    run, outputs = repeat(pieces, taught(pieces), follower_settings=FollowerSettings(limits=limits))
    assert run.finished
    assert all(abs(output.w) <= 0.35 * abs(output.v) + 1e-6 for output in outputs)
    assert distance_to_end(run, pieces) <= 0.10


def test_every_command_is_within_the_limits(taught):
    pieces = [(4, 0), (6, 1.5), (5, -1.5)]
    _, outputs = repeat(pieces, taught(pieces), noise_position=0.05, noise_heading=0.05)
    limits = FollowerSettings().limits
    v, w = (np.array([0.0, *(getattr(output, name) for output in outputs)]) for name in ("v", "w"))
    assert v.max() <= limits.speed + 1e-9
    assert np.abs(w).max() <= limits.turn_rate + 1e-9
    assert np.diff(v).max() <= limits.acceleration * 0.05 + 1e-9
    assert np.diff(v).min() >= -limits.deceleration * 0.05 - 1e-9
    assert np.abs(np.diff(w)).max() <= limits.turn_acceleration * 0.05 + 1e-9


def test_never_passes_the_end_by_more_than_the_tolerance(taught):
    pieces = [(10, 0)]
    for slip in (0.0, 0.05, -0.05):
        run, _ = repeat(pieces, taught(pieces), slip=slip)
        assert run.finished
        assert run.pose[:, 0].max() <= 10.0 + 0.05


def test_slower_while_it_is_not_localized(taught):
    pieces = [(8, 0)]
    _, sure = repeat(pieces, taught(pieces))
    _, unsure = repeat(pieces, taught(pieces), metres=7.0)
    assert max(output.v for output in unsure) < 0.6 * max(output.v for output in sure)
    assert any("localization is poor" in output.reason for output in unsure)


@pytest.mark.parametrize("drive", list(Drive))
@pytest.mark.parametrize("direction", [1, -1])
def test_keeps_to_the_speed_limit_of_a_stretch_from_where_it_begins(taught, direction, drive):
    pieces = [(direction * 8, 0), (direction * 6, 1.5), (direction * 8, 0)]
    poses = taught(pieces)
    limits = np.full(len(poses), 1000.0)
    limits[18:30] = 0.4
    settings = FollowerSettings(limits=Limits(drive=drive, curvature=0.5))
    run, outputs = repeat(pieces, poses, np.eye(4), settings, speed_limits=limits, slip=0.0)
    along = np.array([output.arclength for output in outputs])
    command = np.array([abs(output.v) for output in outputs])
    true_speed = np.linalg.norm(np.diff(run.pose[:, :2], axis=0), axis=1) / World().control_period
    begin, end = (make_path(poses).vertex_s[i] for i in (18, 30))
    assert run.finished
    # What is reported is where the robot will be when the command acts, known to a centimetre or two.
    assert command[(along >= begin) & (along < end)].max() <= 0.4 + 1e-6
    assert true_speed[(along[1:] > begin) & (along[1:] < end)].max() <= 0.43
    assert command[along < begin - 2.5].max() > 0.9
    assert command[along > end + 2.5].max() > 0.9


def test_a_limit_below_the_creeping_speed_is_kept(taught):
    pieces = [(1, 0)]
    poses = taught(pieces)
    _, outputs = repeat(pieces, poses, np.eye(4), speed_limits=[0.05] * len(poses))
    assert max(output.v for output in outputs) <= 0.05 + 1e-9
    assert outputs[-1].finished


def test_limits_that_no_robot_reaches_change_nothing(curves, taught):
    poses = taught(curves)
    free, bounded = (repeat(curves, poses, speed_limits=limits)[0] for limits in ((), [1000.0] * len(poses)))
    assert np.array_equal(free.command, bounded.command)


def test_a_limit_that_comes_late_is_braked_down_to():
    follower, route = PathFollower(), lay_route([(40, 0)], 0.4)
    follower.set_route(route)
    follower.reset_command(1.2)
    follower.set_route(route, [0.3] * len(route))
    speeds = [1.2]
    for _ in range(60):
        output = follower.update(20, np.eye(4), KNOWN, speeds[-1], 0.0, 0.0, 0.0, 0.05)
        assert not output.reason
        speeds.append(output.v)
    assert np.diff(speeds).min() >= -0.5 * 0.05 - 1e-9
    assert speeds[40] <= 0.3 + 1e-6
    assert speeds[-1] == pytest.approx(0.3, abs=0.02)


def test_a_route_with_too_few_speed_limits_is_refused():
    with pytest.raises(LimitError):
        PathFollower().set_route(lay_route([(4, 0)], 0.4), [0.5])


def test_reports_where_the_robot_is():
    follower = PathFollower()
    follower.set_route(lay_route([(10, 0)], 0.5))
    output = follower.update(8, from_xy_yaw(0.1, -0.2, 0.05), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05)
    assert output.lateral_error == pytest.approx(-0.2, abs=1e-3)
    assert output.heading_error == pytest.approx(0.05, abs=1e-3)
    assert output.arclength == pytest.approx(4.1, abs=1e-2)
    assert output.remaining == pytest.approx(5.9, abs=1e-2)
    assert not output.finished


def test_a_route_of_one_vertex_is_finished_at_once():
    follower = PathFollower()
    follower.set_route(np.eye(4)[None])
    output = follower.update(0, np.eye(4), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05)
    assert output.finished
    assert (output.v, output.w) == (0.0, 0.0)


def test_stays_finished_until_there_is_a_new_route():
    follower = PathFollower()
    route = lay_route([(4, 0)], 0.4)
    follower.set_route(route)
    for v in (0.3, 0.0, 0.0):
        output = follower.update(10, np.eye(4), KNOWN, v, 0.0, 0.0, 0.0, 0.05)
    assert output.finished
    assert follower.update(0, np.eye(4), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05).v == 0.0
    follower.set_route(route)
    assert follower.update(0, np.eye(4), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05).v > 0.0


def test_goes_on_where_it_is_after_a_restart_in_the_middle():
    route = lay_route([(6, 0), (-4, 0), (6, 1)], 0.4)
    follower = PathFollower()
    follower.set_route(route)
    outputs = [follower.update(18, np.eye(4), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05) for _ in range(3)]
    assert outputs[-1].v < 0.0
    assert outputs[-1].arclength == pytest.approx(7.2, abs=0.05)


def test_a_robot_that_faces_the_wrong_way_turns_first():
    follower = PathFollower()
    follower.set_route(lay_route([(6, 0)], 0.4))
    output = follower.update(0, from_xy_yaw(0.0, 0.0, 2.5), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05)
    assert output.v == 0.0
    assert output.w < 0.0
    assert output.reason == "turning on the spot"


def test_after_safety_held_the_robot_it_starts_from_rest():
    follower = PathFollower()
    follower.set_route(lay_route([(20, 0)], 0.4))
    for _ in range(30):
        output = follower.update(5, np.eye(4), KNOWN, 0.5, 0.0, 0.0, 0.0, 0.05)
    assert output.v > 0.5
    follower.reset_command()
    assert follower.update(5, np.eye(4), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05).v <= 0.5 * 0.05 + 1e-9


def test_an_update_without_a_route_says_so():
    with pytest.raises(NoRouteError):
        PathFollower().update(0, np.eye(4), KNOWN, 0.0, 0.0, 0.0, 0.0, 0.05)
