"""Dead reckoning adds up motions exactly and uncertainties once."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from common import geometry
from common.geometry import Uncertain
from services.estimator.reckoning import DeadReckoning
from tests.services.estimator.driving import Drive

TWIST = st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6)


@given(st.lists(TWIST, min_size=1, max_size=12), st.integers(1, 5), st.integers(0, 11))
def test_the_pose_is_the_product_of_the_motions_since_the_reference(motions, every, start):
    reckoning, drive = DeadReckoning(), Drive(keyframe_every=every)
    T = np.eye(4)
    for i, motion in enumerate(motions):
        reckoning.move(drive.on(motion))
        T = T @ geometry.exp(motion)
        if i == min(start, len(motions) - 1):
            reckoning.start()
            T = np.eye(4)
    assert np.allclose(reckoning.T_reference_live.T, T, atol=1e-9)
    assert np.linalg.eigvalsh(reckoning.T_reference_live.covariance).min() >= -1e-12


def test_frames_against_one_keyframe_add_no_uncertainty():
    ahead = [0.1, 0, 0, 0, 0, 0]
    few, many = (DeadReckoning() for _ in range(2))
    for reckoning, every in ((few, 40), (many, 4)):
        drive = Drive(keyframe_every=every)
        for _ in range(40):
            reckoning.move(drive.on(ahead))
            if drive.frames == 1:
                reckoning.start()
    one, ten = (np.trace(r.T_reference_live.covariance[:3, :3]) for r in (few, many))
    assert one < ten


def test_an_adjusted_motion_takes_the_place_of_the_measured_one():
    """Whenever it comes; the frames before the reference and those after the keyframe stay as they were."""
    reckoning, drive = DeadReckoning(), Drive(keyframe_every=3)
    ahead = [0.1, 0, 0, 0, 0, 0.02]
    for _ in range(2):
        reckoning.move(drive.on(ahead))
    reckoning.start()
    for _ in range(2):
        reckoning.move(drive.on(ahead))
    measured = geometry.exp(ahead) @ geometry.exp(ahead) @ geometry.exp(ahead)
    better = Uncertain(measured @ geometry.exp([0.01, 0, 0, 0, 0, 0]), np.eye(6) * 1e-6)
    for _ in range(2):
        reckoning.move(replace(drive.on(ahead), T_previous_keyframe=better))
    since_start = geometry.inverse(geometry.exp(ahead) @ geometry.exp(ahead)) @ better.T
    expected = since_start @ measured
    assert np.allclose(reckoning.T_reference_live.T, expected)


def test_an_adjusted_motion_that_ended_before_the_reference_changes_nothing():
    reckoning, drive = DeadReckoning(), Drive(keyframe_every=2)
    ahead = [0.1, 0, 0, 0, 0, 0]
    for _ in range(5):
        reckoning.move(drive.on(ahead))
    reckoning.start()
    step = replace(drive.on(ahead), T_previous_keyframe=Uncertain.exactly(geometry.exp([0.5, 0, 0, 0, 0, 0])))
    reckoning.move(step)
    assert np.allclose(reckoning.T_reference_live.T, geometry.exp(ahead))


def test_a_reference_is_where_the_live_frame_is_known_to_be():
    reckoning, drive = DeadReckoning(), Drive(keyframe_every=5)
    T_vertex_live = Uncertain(geometry.exp([0.3, 0.2, 0, 0, 0, 0.1]), np.eye(6) * 1e-4)
    for _ in range(3):
        reckoning.move(drive.on([0.1, 0, 0, 0, 0, 0]))
    reckoning.start(T_vertex_live)
    assert np.array_equal(reckoning.T_reference_live.T, T_vertex_live.T)
    assert np.array_equal(reckoning.T_reference_live.covariance, T_vertex_live.covariance)
    for _ in range(4):
        reckoning.move(drive.on([0.1, 0, 0, 0, 0, 0]))
    assert np.allclose(reckoning.T_reference_live.T, T_vertex_live.T @ geometry.exp([0.4, 0, 0, 0, 0, 0]))


def test_the_first_frame_ever_is_the_one_that_was_meant():
    reckoning, drive = DeadReckoning(), Drive()
    reckoning.start(Uncertain.exactly(geometry.exp([1.0, 0, 0, 0, 0, 0])))
    reckoning.move(drive.on([0.1, 0, 0, 0, 0, 0]))
    assert np.allclose(reckoning.T_reference_live.T, geometry.exp([1.0, 0, 0, 0, 0, 0]))
