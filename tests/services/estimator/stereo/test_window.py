"""The window beside odometry: fed with keyframes of a drive past textured planes, rendered from known poses."""

from dataclasses import replace
from itertools import pairwise
from threading import Event, Thread

import numpy as np
import pytest

from common import geometry
from services.estimator.stereo import StereoOdometry, StereoSettings
from services.estimator.stereo import window as module
from services.estimator.stereo.window import WindowAdjuster
from tests.services.estimator.stereo.scene import CAMERA, render

STEP = geometry.exp([0.01, 0.0, 0.15, 0.0, 0.01, 0.0])
POSES = [np.linalg.matrix_power(STEP, i) for i in range(8)]
DT = 100_000_000
DEFAULT = StereoSettings()
SETTINGS = replace(
    DEFAULT,
    # Every pair is a keyframe, so that a short drive fills a window.
    odometry=replace(DEFAULT.odometry, keyframe_distance=0.05),
    bundle=replace(DEFAULT.bundle, enabled=True, keyframes=4),
)
LEFT_BEHIND_S = 20.0
"""How long a thread may take before it counts as one that will never end."""


class Notes(WindowAdjuster):
    """Remembers what it was given, and what it made of that."""

    def __init__(self, settings=SETTINGS):
        super().__init__(CAMERA, settings, synchronous=True)
        self.given, self.made = [], []

    def put(self, keyframe):
        self.given.append(keyframe)
        super().put(keyframe)

    def take(self):
        taken = super().take()
        if taken is not None:
            self.made.append(taken)
        return taken


@pytest.fixture(scope="module")
def pairs():
    return [render(T, seed=i) for i, T in enumerate(POSES)]


@pytest.fixture(scope="module")
def keyframes(pairs):
    """What odometry hands over of the drive."""
    return _drive(pairs)[0].given


def _drive(pairs, settings=SETTINGS, adjuster=None):
    adjuster = adjuster or Notes(settings)
    odometry = StereoOdometry(CAMERA, settings, adjuster)
    return adjuster, [odometry.process(*pair, i * DT) for i, pair in enumerate(pairs)]


def _adjust(keyframes, settings=SETTINGS):
    """What a window says of each keyframe in turn."""
    adjuster, said = WindowAdjuster(CAMERA, settings, synchronous=True), []
    for keyframe in keyframes:
        adjuster.put(keyframe)
        said.append(adjuster.take())
    return said


def _error(T, truth):
    return np.linalg.norm((geometry.inverse(truth) @ T)[:3, 3])


def test_odometry_hands_over_every_keyframe_with_what_it_shares_with_the_one_before(keyframes):
    assert [k.number for k in keyframes] == list(range(len(POSES)))
    assert len(keyframes[0].links.features) == 0
    for before, keyframe in pairwise(keyframes):
        links = keyframe.links
        assert len(links.features) > 60
        assert _error(keyframe.T_previous_keyframe, STEP) < 0.01
        corners = {tuple(c) for c in before.frame.features.measurements[:, :2]}
        assert all(tuple(c) in corners for c in links.corners)
        np.testing.assert_allclose(links.places, keyframe.frame.features.measurements[links.features, :2], atol=3.0)


def test_the_first_keyframe_says_nothing_and_every_later_one_something(keyframes):
    said = _adjust(keyframes)
    assert said[0] is None
    assert [a.keyframe for a in said[1:]] == list(range(1, len(POSES)))


def test_the_newest_pose_is_close_to_the_truth_and_honest(keyframes):
    nees = []
    for i, adjustment in enumerate(_adjust(keyframes)[1:], start=1):
        assert _error(adjustment.T_odom_keyframe, POSES[i]) < 0.02
        error = geometry.log(STEP @ geometry.inverse(adjustment.T_previous_keyframe.T))
        nees.append(error @ np.linalg.solve(adjustment.T_previous_keyframe.covariance, error))
    # Seven motions of 6 degrees of freedom that share landmarks: far from a proof, but not off by an order.
    assert 0.5 < np.mean(nees) < 15.0


def test_landmarks_are_followed_over_more_than_two_keyframes(keyframes):
    adjuster = WindowAdjuster(CAMERA, SETTINGS, synchronous=True)
    for keyframe in keyframes[:4]:
        adjuster.put(keyframe)
    problem, _ = adjuster._problem()
    seen = np.bincount(problem.landmarks)
    assert len(problem.T_keyframes_first) == 4
    assert (seen == 3).sum() > 20, "seen by all four, the anchor included"
    assert (seen[np.unique(problem.landmarks)] >= 1).all()
    assert (problem.keyframes > problem.anchors[problem.landmarks]).all()


def test_where_a_track_was_found_again_it_truly_is(keyframes):
    """The patch of the first keyframe is found where its landmark reprojects, however many keyframes later."""
    adjuster = WindowAdjuster(CAMERA, SETTINGS, synchronous=True)
    for keyframe in keyframes[:4]:
        adjuster.put(keyframe)
    problem, _ = adjuster._problem()
    errors = {}
    for i, j, measured in zip(problem.landmarks, problem.keyframes, problem.measured, strict=True):
        place, seen = problem.uvd[i], np.zeros(3)
        T = geometry.inverse(POSES[j]) @ POSES[problem.anchors[i]]
        module.model.predict(place, T, module.model.intrinsics(CAMERA), seen)
        errors.setdefault(int(j - problem.anchors[i]), []).append(np.abs(measured - seen))
    assert set(errors) == {1, 2, 3}
    for apart in errors.values():
        np.testing.assert_array_less(np.median(apart, axis=0), 0.25)


def test_the_window_slides(keyframes):
    adjuster = WindowAdjuster(CAMERA, SETTINGS, synchronous=True)
    for keyframe in keyframes:
        adjuster.put(keyframe)
        numbers = [view.keyframe.number for view in adjuster._views]
        assert numbers == list(range(max(0, keyframe.number - 3), keyframe.number + 1))
    alive = np.concatenate([view.tracks for view in adjuster._views])
    anchored = {first for first, _ in adjuster._anchors.values()}
    assert anchored <= set(numbers)
    assert set(alive[alive >= 0].tolist()) <= set(adjuster._anchors)


def test_what_a_sliding_window_says_fits_what_it_said_before(keyframes):
    """Held is only the oldest keyframe: poses do not jump when another one becomes the oldest."""
    said = _adjust(keyframes)[1:]
    for before, after in pairwise(said):
        step = geometry.inverse(before.T_odom_keyframe) @ after.T_odom_keyframe
        assert _error(step, STEP) < 0.01


def test_the_same_keyframes_give_the_same_to_the_last_bit(pairs, keyframes):
    again = _drive(pairs)[1]
    first = _drive(pairs)[1]
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(a.T_odom_live, b.T_odom_live)
    for a, b in zip(_adjust(keyframes)[1:], _adjust(keyframes)[1:], strict=True):
        assert np.array_equal(a.T_odom_keyframe, b.T_odom_keyframe)
        assert np.array_equal(a.features.landmarks, b.features.landmarks)


def test_a_missing_keyframe_begins_the_window_anew(keyframes):
    said = _adjust([*keyframes[:3], *keyframes[4:6]])
    assert said[2].keyframe == 2
    assert said[3] is None, "of the one after the gap alone nothing is known"
    assert said[4].keyframe == 5
    step = geometry.inverse(keyframes[4].T_odom_keyframe) @ said[4].T_odom_keyframe
    assert _error(step, STEP) < 0.01, "and its pose follows odometry's of the one after the gap"


def test_a_keyframe_that_shares_nothing_begins_the_window_anew(keyframes):
    none = keyframes[2].links
    alone = replace(keyframes[2], links=type(none)(*(part[:0] for part in none)))
    said = _adjust([*keyframes[:2], alone, keyframes[3]])
    assert said[2] is None
    assert said[3].keyframe == 3


def test_an_adjustment_is_taken_once(keyframes):
    adjuster = WindowAdjuster(CAMERA, SETTINGS, synchronous=True)
    for keyframe in keyframes[:2]:
        adjuster.put(keyframe)
    assert adjuster.take() is not None
    assert adjuster.take() is None


def test_odometry_goes_on_from_the_adjusted_pose(pairs):
    """Synchronously an adjustment is there at the next pair."""
    adjuster, results = _drive(pairs)
    assert [a.keyframe for a in adjuster.made] == list(range(1, len(POSES) - 1))
    for adjustment, result in zip(adjuster.made, results[2:], strict=True):
        expected = adjustment.T_odom_keyframe @ result.T_keyframe_live.T
        np.testing.assert_allclose(result.T_odom_live, expected, atol=1e-9)
        assert result.T_previous_keyframe is adjustment.T_previous_keyframe


def test_refined_landmarks_are_more_certain_and_no_worse(keyframes):
    adjustment = _adjust(keyframes)[-1]
    before, after = keyframes[-1].frame.features, adjustment.features
    assert np.array_equal(before.measurements[:, :2], after.measurements[:, :2])
    better = after.disparity_sigmas < before.disparity_sigmas
    assert better.sum() > 60
    assert (after.disparity_sigmas <= before.disparity_sigmas).all()


def _slow(monkeypatch):
    """An adjustment that goes on until it is allowed to end; the two events are its beginning and its end."""
    began, go_on, adjust = Event(), Event(), module.bundle_adjustment.adjust

    def slow(*arguments):
        began.set()
        assert go_on.wait(LEFT_BEHIND_S)
        return adjust(*arguments)

    monkeypatch.setattr(module.bundle_adjustment, "adjust", slow)
    return began, go_on


def _running(adjuster):
    stop = Event()
    thread = Thread(target=adjuster.run, args=(stop,), daemon=True)
    thread.start()
    return stop, thread


def test_odometry_never_waits_for_an_adjustment(pairs, monkeypatch):
    """The whole drive ends while the first adjustment is still at work: else this test would."""
    began, go_on = _slow(monkeypatch)
    adjuster = WindowAdjuster(CAMERA, SETTINGS)
    stop, thread = _running(adjuster)
    odometry = StereoOdometry(CAMERA, SETTINGS, adjuster)
    results = [odometry.process(*pair, i * DT) for i, pair in enumerate(pairs[:2])]
    assert began.wait(LEFT_BEHIND_S)
    results += [odometry.process(*pair, (2 + i) * DT) for i, pair in enumerate(pairs[2:])]
    assert not go_on.is_set()
    assert all(r.success for r in results)
    assert adjuster.take() is None
    stop.set()
    go_on.set()
    thread.join(LEFT_BEHIND_S)
    assert not thread.is_alive()


def test_an_adjustment_of_an_older_keyframe_is_not_taken_for_the_present_one(pairs):
    class Late(Notes):
        """Gives every adjustment one keyframe late."""

        def take(self):
            late, self.late = getattr(self, "late", None), super().take()
            return late

    plain = StereoOdometry(CAMERA, SETTINGS)
    expected = [plain.process(*pair, i * DT).T_odom_live for i, pair in enumerate(pairs)]
    _, results = _drive(pairs, adjuster=Late())
    for result, T in zip(results, expected, strict=True):
        assert np.array_equal(result.T_odom_live, T)


def test_a_thread_does_the_work_and_ends_when_told(keyframes):
    adjuster = WindowAdjuster(CAMERA, SETTINGS)
    finished = Event()
    add = adjuster._add

    def noting(keyframe):
        adjustment = add(keyframe)
        if adjustment is not None:
            finished.set()
        return adjustment

    adjuster._add = noting
    stop, thread = _running(adjuster)
    for keyframe in keyframes[:2]:
        adjuster.put(keyframe)
    assert finished.wait(LEFT_BEHIND_S)
    stop.set()
    thread.join(LEFT_BEHIND_S)
    assert not thread.is_alive()
    assert adjuster.take().keyframe == 1


def test_too_many_waiting_keyframes_are_let_go(keyframes):
    """With nobody at work only the latest are kept, however many come."""
    adjuster = WindowAdjuster(CAMERA, SETTINGS)
    for keyframe in keyframes:
        adjuster.put(keyframe)
    adjuster._work()
    assert adjuster.take().keyframe == len(POSES) - 1
    assert adjuster._views[0].keyframe.number == len(POSES) - 4
