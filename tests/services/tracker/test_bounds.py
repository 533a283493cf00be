"""Whatever a follower is told, each of its commands is one that the vehicle can follow, or there is none."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.geometry import from_xy_yaw
from services.tracker.follower import FollowerSettings, PathFollower
from services.tracker.path import RouteError
from services.tracker.ramp import within
from services.tracker.replay import ActionReplay, Motion
from services.tracker.simulation import lay_route
from services.tracker.speed import CautionSettings
from tests.services.tracker.vehicles import all_limits, assert_possible

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")

anything = st.floats(allow_nan=True, allow_infinity=True)
angle = st.floats(-math.pi, math.pi)
plausible = st.floats(-2.0, 2.0)
often_plausible = plausible | plausible | plausible | anything
poses = st.builds(from_xy_yaw, often_plausible, often_plausible, angle | angle | anything)
covariances = st.builds(lambda variance: variance * np.eye(6), st.floats(0.0, 1.0) | anything)
since_success = st.floats(0.0, 20.0) | anything
seconds = st.floats(1e-3, 0.2)
routes = st.lists(
    st.tuples(st.floats(-4.0, 4.0), st.floats(-2.0, 2.0)).filter(lambda piece: piece != (0.0, 0.0)),
    min_size=1, max_size=4,
)  # fmt: skip
moments = st.lists(
    st.tuples(
        st.integers(-1, 30), poses, covariances, often_plausible, often_plausible, since_success, since_success, seconds
    ),
    min_size=1, max_size=12,
)  # fmt: skip


@st.composite
def routes_with_limits(draw):
    route = lay_route(draw(routes), 0.4)
    limit = st.floats(0.01, 3.0)
    return route, draw(st.just([]) | st.lists(limit, min_size=len(route), max_size=len(route)))


@settings(max_examples=60)
@given(all_limits(), routes_with_limits(), moments, plausible, plausible)
def test_every_command_of_the_path_follower_is_possible(limits, route, moments, v, w):
    follower = PathFollower(FollowerSettings(limits=limits))
    follower.set_route(*route)
    last = within(v, w, limits)
    follower.reset_command(*last)
    for *moment, dt in moments:
        try:
            output = follower.update(*moment, dt)
        except RouteError:
            continue
        assert_possible(limits, last, (output.v, output.w), dt)
        assert np.isfinite([output.lateral_error, output.heading_error, output.arclength, output.remaining]).all()
        last = output.v, output.w


@settings(max_examples=60)
@given(
    all_limits(),
    routes_with_limits(),
    moments,
    st.lists(st.tuples(often_plausible, often_plausible, often_plausible), max_size=5),
    poses,
)
def test_every_command_of_the_replay_is_possible(limits, route, moments, actions, T_frame_acting):
    replay = ActionReplay(limits, CautionSettings())
    replay.set_route(*route)
    last = 0.0, 0.0
    for trunk, T, covariance, v, w, metres, since, dt in moments:
        motion = Motion(np.eye(4), T_frame_acting, v, w)
        try:
            output = replay.update(trunk, T, covariance, np.array(actions), motion, metres, since, dt)
        except RouteError:
            continue
        assert_possible(limits, last, (output.v, output.w), dt)
        last = output.v, output.w
