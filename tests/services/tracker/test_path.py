import math

import numpy as np
import pytest

from common.geometry import exp, from_xy_yaw, inverse
from services.tracker.path import PathSettings, RouteError, make_path, wrap
from services.tracker.simulation import lay_route


def test_passes_within_two_centimetres_of_every_vertex(curves, taught):
    path = make_path(taught(curves, noise=0.008))
    section = path.sections[0]
    at = path.vertex_s
    nearest = np.stack([np.interp(at, section.s, section.x), np.interp(at, section.s, section.y)], axis=1)
    assert np.linalg.norm(nearest - path.vertices[:, :2], axis=1).max() <= 0.021
    assert path.length == pytest.approx(60.0, abs=0.2)


def test_curvature_is_that_of_the_circle_and_free_of_the_noise(taught):
    section = make_path(taught([(24, 6)], noise=0.003)).sections[0]
    inner = slice(20, -20)
    assert np.abs(section.curvature[inner] - 0.25).max() < 0.03
    assert np.abs(np.diff(section.curvature)).max() < 0.02


def test_an_exact_circle_is_not_pulled_inwards():
    path = make_path(lay_route([(24, 6)], 0.4))
    centre = np.array([0.0, 4.0])
    section = path.sections[0]
    radius = np.linalg.norm(np.stack([section.x, section.y], axis=1) - centre, axis=1)
    assert np.abs(radius - 4.0).max() < 2e-3


def test_a_robot_is_found_beside_the_path(curves):
    route = lay_route(curves, 0.4)
    path = make_path(route)
    robot = from_xy_yaw(0.0, 0.25, 0.1)
    places = [path.project(0, trunk, path.place(trunk, robot)) for trunk in range(len(route))]
    lateral, heading, s = (np.array([getattr(place, name) for place in places]) for name in ("lateral", "heading", "s"))
    # Where the taught curvature jumps, the smooth path leaves the vertices by up to a centimetre.
    assert np.median(np.abs(lateral - 0.25)) < 1e-3
    assert np.abs(lateral - 0.25).max() < 1e-2
    assert np.median(np.abs(heading - 0.1)) < 5e-3
    assert np.abs(s - path.vertex_s).max() < 0.03


def test_a_route_that_crosses_itself_is_never_taken_for_another_part_of_itself():
    loop = 8 * math.pi
    route = lay_route([(loop, 2 * math.pi), (loop, -2 * math.pi)], 0.4)
    path = make_path(route)
    crossing = int(np.argmin(np.abs(path.vertex_s - loop)))
    for trunk in (2, crossing, len(route) - 3):
        place = path.project(0, trunk, path.place(trunk, np.eye(4)))
        assert place.s == pytest.approx(path.vertex_s[trunk], abs=0.05)


def test_drift_far_away_changes_nothing_here(curves):
    route = lay_route(curves, 0.4)
    drifted, steps = route.copy(), inverse(route[:-1]) @ route[1:]
    for k in range(80, len(steps)):
        drifted[k + 1] = drifted[k] @ steps[k] @ exp([4e-3, 2e-3, 1e-3, 0, 1e-3, 5e-3])
    assert np.linalg.norm(drifted[-1, :3, 3] - route[-1, :3, 3]) > 3.0
    robot = from_xy_yaw(0.1, 0.2, 0.05)
    places = [path.project(0, 40, path.place(40, robot)) for path in map(make_path, (route, drifted))]
    assert places[0].lateral == pytest.approx(places[1].lateral, abs=1e-3)
    assert places[0].heading == pytest.approx(places[1].heading, abs=1e-3)


def test_a_kink_stays_a_local_matter(taught):
    straight = taught([(30, 0)], noise=0.003)
    kinked = straight.copy()
    kinked[40:] = kinked[40:] @ from_xy_yaw(0.0, 0.08, 0.0)
    smooth, rough = (make_path(poses).sections[0] for poses in (straight, kinked))
    assert np.abs(rough.curvature[:120]).max() < np.abs(smooth.curvature).max() + 0.01


def test_a_hill_has_the_length_that_was_driven():
    up, down = exp([0.4, 0, 0, 0, -0.03, 0]), exp([0.4, 0, 0, 0, 0.03, 0])
    poses = [np.eye(4)]
    for step in [up] * 20 + [down] * 20:
        poses.append(poses[-1] @ step)
    path = make_path(np.array(poses))
    assert path.length == pytest.approx(16.0, abs=0.01)
    assert np.abs(path.sections[0].y).max() < 1e-6


def test_sections_are_cut_where_the_direction_changes_and_where_the_robot_turned_on_the_spot():
    path = make_path(lay_route([(6, 0), (-4, 0.4), (0, 1.5), (5, 0)], 0.4))
    assert [section.direction for section in path.sections] == [1, -1, 1]
    assert [section.end - section.start for section in path.sections] == pytest.approx([6, 4, 5], abs=0.02)
    assert wrap(path.sections[1].robot_heading(7.0)) == pytest.approx(0.1, abs=0.03)
    assert wrap(path.sections[2].robot_heading(11.0)) == pytest.approx(1.9, abs=0.03)


def test_a_robot_at_rest_among_the_vertices_does_not_cut_the_path():
    route = lay_route([(4, 0)], 0.4)
    jitter = np.array([route[5] @ from_xy_yaw(x, 0.0, 0.01) for x in (-0.01, 0.01, -0.02)])
    path = make_path(np.concatenate([route[:6], jitter, route[6:]]))
    assert len(path.sections) == 1
    assert path.length == pytest.approx(4.0, abs=0.06)


@pytest.mark.parametrize("back", [-0.05, 0.0, 0.03, 0.09, 0.29])
@pytest.mark.parametrize("direction", [1, -1])
def test_where_a_map_begins_a_little_behind_the_end_of_another_the_path_goes_straight_on(back, direction):
    first = lay_route([(4 * direction, 0)], 0.4)
    second = first[-1] @ from_xy_yaw(-back * direction, 0.03, 0.02) @ lay_route([(4 * direction, 0)], 0.4)
    path = make_path(np.concatenate([first, second]))
    (section,) = path.sections
    assert section.direction == direction
    assert path.length == pytest.approx(8.0 - back, abs=0.06)
    assert np.ptp(section.heading) < 0.25
    assert np.diff(path.vertex_s).min() >= 0.0


def test_a_short_way_back_that_goes_on_is_a_change_of_direction():
    path = make_path(lay_route([(4, 0), (-0.5, 0), (4, 0)], 0.25))
    assert [section.direction for section in path.sections] == [1, -1, 1]


def test_beyond_the_end_the_arclength_runs_on():
    path = make_path(lay_route([(4, 0)], 0.4))
    place = path.project(0, 10, path.place(10, from_xy_yaw(0.3, 0.1, 0.0)))
    assert place.s == pytest.approx(4.3, abs=1e-3)
    assert place.lateral == pytest.approx(0.1, abs=1e-3)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_shortest_routes_are_straight(count):
    path = make_path(lay_route([(0.4, 0)] * 2, 0.4)[:count])
    assert path.length == pytest.approx(0.4 * (count - 1), abs=1e-6)
    assert all(np.abs(section.curvature).max() < 1e-6 for section in path.sections)


@pytest.mark.parametrize("poses", [np.zeros((0, 4, 4)), np.eye(4), np.full((3, 4, 4), np.nan), np.zeros((3, 4, 4))])
def test_refuses_what_is_no_route(poses):
    with pytest.raises(RouteError):
        make_path(poses)


def test_refuses_a_trunk_that_is_not_on_the_route():
    path = make_path(lay_route([(4, 0)], 0.4), PathSettings())
    with pytest.raises(RouteError):
        path.place(99, np.eye(4))
    with pytest.raises(RouteError):
        path.place(0, np.full((4, 4), np.nan))


def test_the_frame_of_the_poses_does_not_matter(curves):
    route = lay_route(curves, 0.4)
    one, other = make_path(route), make_path(inverse(route[50]) @ route)
    assert np.allclose(one.vertices, other.vertices, atol=1e-9)
