import math

import numpy as np
import pytest

from common.geometry import from_xy_yaw
from services.tracker.follower import FollowerSettings, NoRouteError, PathFollower
from services.tracker.limits import Drive, Limits
from services.tracker.simulation import World, drive, lay_route, true_errors

KNOWN = 1e-4 * np.eye(6)
OFFSET = from_xy_yaw(0.0, 0.3, math.radians(5.0))


def repeat(pieces, poses, start=OFFSET, follower_settings=None, metres=0.0, **world):
    """Drive a route of which `poses` were taught; returns the run and all outputs of the tracker."""
    follower, outputs = PathFollower(follower_settings), []
    follower.set_route(poses)

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
