import math

import numpy as np
import pytest

from common.geometry import exp, from_xy_yaw
from services.tracker.predict import BaseModel, StatePredictor, Twist, arc, move, respond


def test_an_arc_is_the_exponential_of_its_twist():
    for v, w in [(1.0, 0.0), (1.0, 0.7), (-0.5, 0.7), (0.0, 1.0), (1.0, 1e-9)]:
        assert np.allclose(arc(v, w, 1.3), exp(1.3 * np.array([v, 0, 0, 0, 0, w])), atol=1e-12)


def test_moves_through_the_twists_that_held_between_two_times():
    twists = [Twist(0.0, 1.0, 0.0), Twist(1.0, 1.0, math.pi / 2), Twist(2.0, 2.0, 0.0)]
    expected = arc(1.0, 0.0, 0.5) @ arc(1.0, math.pi / 2, 1.0) @ arc(2.0, 0.0, 0.25)
    start = from_xy_yaw(3.0, 1.0, 0.4)
    assert np.allclose(move(start, twists, 0.5, 2.25), start @ expected)


def test_the_first_twist_also_holds_before_its_stamp_and_the_last_for_ever():
    assert np.allclose(move(np.eye(4), [Twist(5.0, 1.0, 0.0)], 4.0, 7.0), from_xy_yaw(3.0, 0.0, 0.0))


@pytest.mark.parametrize("twists", [[], [Twist(0.0, 1.0, 1.0)]])
def test_nothing_moves_without_twists_or_time(twists):
    start = exp([1, 2, 3, 0.1, 0.2, 0.3])
    assert np.allclose(move(start, twists, 2.0, 2.0), start)


def test_the_base_answers_after_its_delay_with_its_lag():
    model = BaseModel(delay=0.1, lag=0.2)
    twists = respond(Twist(0.0, 0.0, 0.0), [Twist(-1.0, 0.0, 0.0), Twist(0.0, 1.0, -0.5)], 0.5, model)
    assert all(twist.v == 0.0 for twist in twists if twist.stamp < 0.09)
    assert twists[-1].v == pytest.approx(1.0 - math.exp(-0.4 / 0.2), abs=1e-6)
    assert twists[-1].w == pytest.approx(-0.5 * twists[-1].v, abs=1e-9)


def test_predicts_where_a_simulated_base_really_is():
    model, step = BaseModel(delay=0.06, lag=0.15), 0.01
    predictor, T, v, w = StatePredictor(model), np.eye(4), 0.0, 0.0
    sent, frame = [], None
    for k in range(130):
        now = k * step
        if k % 2 == 0 and now <= 1.0:
            predictor.odometry(now, v, w)
        if k % 5 == 0 and now <= 1.0:
            sent.append(Twist(now, math.sin(3.0 * now), math.cos(2.0 * now)))
            predictor.command(*(getattr(sent[-1], name) for name in ("stamp", "v", "w")))
        if k == 80:
            frame = T
        if k == 106:
            break
        goal = next((c for c in reversed(sent) if c.stamp + model.delay <= now + 1e-9), Twist(0, 0, 0))
        share = 1.0 - math.exp(-step / model.lag)
        v, w = v + share * (goal.v - v), w + share * (goal.w - w)
        T = T @ arc(v, w, step)
    predicted, v_then, w_then = predictor.predict(frame, 0.8, 1.0)
    assert np.abs(predicted - T).max() < 0.012
    assert (v_then, w_then) == pytest.approx((v, w), abs=0.05)


def test_ignores_what_is_late_or_not_finite_and_forgets_what_is_old():
    predictor = StatePredictor(BaseModel(delay=0.0, lag=0.0, history=1.0))
    predictor.odometry(0.0, 9.0, 0.0)
    predictor.odometry(2.0, 1.0, 0.0)
    predictor.odometry(1.5, 9.0, 9.0)
    predictor.odometry(2.5, math.nan, 0.0)
    T, v, w = predictor.predict(np.eye(4), 1.0, 3.0)
    assert np.allclose(T, from_xy_yaw(2.0, 0.0, 0.0))
    assert (v, w) == (1.0, 0.0)


def test_without_odometry_the_pose_stays():
    T, v, w = StatePredictor().predict(np.eye(4), 0.0, 1.0)
    assert np.array_equal(T, np.eye(4))
    assert (v, w) == (0.0, 0.0)


def test_odometry_that_ended_long_ago_tells_nothing():
    predictor = StatePredictor(BaseModel(delay=0.05, lag=0.15, history=1.0))
    predictor.odometry(0.0, 1.0, 0.5)
    T, v, w = predictor.predict(np.eye(4), 3600.0, 3600.0)
    assert np.array_equal(T, np.eye(4))
    assert (v, w) == (0.0, 0.0)
