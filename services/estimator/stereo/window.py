"""The sliding window of keyframes beside odometry: it follows landmarks from keyframe to keyframe and adjusts them all.

Odometry drops off every new keyframe with the landmarks that it shares with the one before, and picks up what is
finished; neither waits. A landmark that was followed is measured again in each keyframe with the patch of the keyframe
that saw it first, so that errors do not add up along its track. What comes back are the newest keyframe's pose and
landmarks as the whole window sees them, and the rectification.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from threading import Condition, Event
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common import geometry
from common.camera import StereoCamera
from common.geometry import Array, Uncertain
from services.estimator.stereo import bundle_adjustment, matching, model, refinement
from services.estimator.stereo.features import FeatureSet, StereoFrame
from services.estimator.stereo.rectification import Rectification, triangulate
from services.estimator.stereo.settings import StereoSettings

Indices = NDArray[np.int64]

_WAIT_S = 0.2
_PENDING = 4
"""Keyframes that wait at most; when more come, the oldest is let go and the window begins anew."""
_AGREEMENT = 4.0
"""Standard deviations by which a landmark's adjusted disparity may differ from its keyframe's own."""


class Links(NamedTuple):
    """K landmarks of one keyframe found again in the next.

    Attributes:
        corners: (K, 2) their corners in the keyframe before, whole pixels.
        features: (K,) indices into the features of this one.
        places: (K, 2) where the patches of ``corners`` were found in this one's left image, pixels.
        noise: (K, 2, 2) covariance of the place.
    """

    corners: NDArray[np.float32]
    features: Indices
    places: Array
    noise: Array


@dataclass(frozen=True, slots=True)
class WindowKeyframe:
    """A keyframe as odometry hands it over.

    Attributes:
        number: running number.
        frame: the pair, with its features as they were measured.
        T_odom_keyframe: (4, 4) its pose by odometry.
        T_previous_keyframe: (4, 4) its motion since the keyframe before.
        links: landmarks shared with the keyframe before.
        rectification: what was known of it, from all pairs up to this one.
    """

    number: int
    frame: StereoFrame
    T_odom_keyframe: Array
    T_previous_keyframe: Array
    links: Links
    rectification: Rectification


@dataclass(frozen=True, slots=True)
class Adjustment:
    """What a window says of its newest keyframe.

    Attributes:
        keyframe: its number.
        T_odom_keyframe: (4, 4) its pose.
        T_previous_keyframe: its motion since the keyframe before, with covariance.
        features: its features, with the landmarks and covariances of the whole window.
        rectification: by all measurements of the window.
        landmarks: how many landmarks took part.
    """

    keyframe: int
    T_odom_keyframe: Array
    T_previous_keyframe: Uncertain
    features: FeatureSet
    rectification: Rectification
    landmarks: int


@dataclass(slots=True)
class _View:
    """A keyframe in the window, and the tracks that it saw.

    Attributes:
        T_keyframe_first: from the window's first optical frame to this one's.
        uvd: (N, 3) its features as they were measured, pixels.
        tracks: (N,) track of each feature, -1 where it has none.
        places, noise: (N, 2) and (N, 2, 2), of the track's point, pixels; not the corner where the patch is another's.
    """

    keyframe: WindowKeyframe
    T_keyframe_first: Array
    uvd: Array
    tracks: Indices
    places: Array
    noise: Array


class WindowAdjuster:
    """Bundle adjustment over the last keyframes of one odometry.

    :meth:`put` and :meth:`take` are odometry's and never wait; :meth:`run` belongs to a thread of its own. With
    ``synchronous`` there is no thread: :meth:`put` does the work itself, so that the outcome does not depend on timing.
    """

    def __init__(
        self, camera: StereoCamera, settings: StereoSettings | None = None, *, synchronous: bool = False
    ) -> None:
        self._camera = camera
        self._settings = settings or StereoSettings()
        self._intrinsics = model.intrinsics(camera)
        self._synchronous = synchronous
        self._changed = Condition()
        self._pending: deque[WindowKeyframe] = deque(maxlen=_PENDING)
        self._finished: Adjustment | None = None
        self._views: list[_View] = []
        self._T_odom_first: Array = np.eye(4)
        self._anchors: dict[int, tuple[int, int]] = {}
        self._next_track = 0

    def put(self, keyframe: WindowKeyframe) -> None:
        """Hand over a new keyframe."""
        with self._changed:
            self._pending.append(keyframe)
            self._changed.notify()
        if self._synchronous:
            self._work()

    def take(self) -> Adjustment | None:
        """The latest adjustment that was not taken yet; None where there is none."""
        with self._changed:
            finished, self._finished = self._finished, None
        return finished

    def run(self, stop: Event) -> None:
        """Adjust what comes, until ``stop`` is set."""
        while not stop.is_set():
            with self._changed:
                self._changed.wait_for(lambda: bool(self._pending), _WAIT_S)
            self._work()

    def _work(self) -> None:
        while True:
            with self._changed:
                if not self._pending:
                    return
                keyframe = self._pending.popleft()
            adjustment = self._add(keyframe)
            with self._changed:
                self._finished = adjustment

    def _add(self, keyframe: WindowKeyframe) -> Adjustment | None:
        """Take a keyframe into the window and adjust it; None where it has nothing to say."""
        last = self._views[-1] if self._views else None
        if last is None or keyframe.number != last.keyframe.number + 1 or len(keyframe.links.features) == 0:
            self._restart(keyframe)
            return None
        view = _view(keyframe, geometry.inverse(keyframe.T_previous_keyframe) @ last.T_keyframe_first)
        # First, so that what the last keyframe shares with the new one begins a new track where the old one ends.
        if len(self._views) >= self._settings.bundle.keyframes:
            view.T_keyframe_first = view.T_keyframe_first @ self._slide()
        self._views.append(view)
        self._follow(last, view)
        problem, tracks = self._problem()
        adjusted = bundle_adjustment.adjust(problem, self._intrinsics, self._settings.bundle)
        if adjusted is None:
            self._restart(keyframe)
            return None
        for T, seen in zip(adjusted.T_keyframes_first, self._views, strict=True):
            seen.T_keyframe_first = T
        return self._adjustment(adjusted, tracks)

    def _restart(self, keyframe: WindowKeyframe) -> None:
        """Begin anew with one keyframe."""
        self._views = [_view(keyframe, np.eye(4))]
        self._T_odom_first = keyframe.T_odom_keyframe
        self._anchors.clear()

    def _slide(self) -> Array:
        """Let the oldest keyframe go, and the tracks that began in it; returns ``T_old_new`` of the first frames."""
        gone = self._views.pop(0).keyframe.number
        self._anchors = {track: anchor for track, anchor in self._anchors.items() if anchor[0] != gone}
        alive = np.array(sorted(self._anchors), dtype=np.int64)
        first = geometry.inverse(self._views[0].T_keyframe_first)
        self._T_odom_first = geometry.normalize(self._T_odom_first @ first)
        for view in self._views:
            view.T_keyframe_first = view.T_keyframe_first @ first
            view.tracks[~np.isin(view.tracks, alive)] = -1
        return first

    def _follow(self, last: _View, view: _View) -> None:
        """Give the new keyframe's features their tracks: those of the last keyframe's that go on, and new ones."""
        links = view.keyframe.links
        previous = _at_corners(last, links.corners)
        tracks, places, noise = last.tracks[previous].copy(), links.places.copy(), links.noise.copy()
        moved = last.places[previous] - last.uvd[previous, :2]
        known = np.flatnonzero(tracks >= 0)
        anchors = np.array([self._anchors[t] for t in tracks[known]], dtype=np.int64).reshape(-1, 2)
        for seen in self._views[:-1]:
            rows = anchors[:, 0] == seen.keyframe.number
            if seen is last or not rows.any():
                continue
            chosen = known[rows]
            starts = places[chosen] + moved[chosen]
            found, covariance, good = self._align(seen, anchors[rows, 1], view, starts)
            places[chosen], noise[chosen] = found, covariance
            lost = chosen[~good]
            tracks[lost], places[lost], noise[lost] = -1, links.places[lost], links.noise[lost]
        for row in np.flatnonzero(tracks < 0):
            tracks[row] = last.tracks[previous[row]] = self._next_track
            self._anchors[self._next_track] = last.keyframe.number, int(previous[row])
            self._next_track += 1
        # A track that starts in the last keyframe is measured there at the corner itself.
        fresh = previous[[self._anchors[t][0] == last.keyframe.number for t in tracks.tolist()]]
        last.places[fresh] = last.uvd[fresh, :2]
        view.tracks[links.features], view.places[links.features], view.noise[links.features] = tracks, places, noise

    def _align(self, seen: _View, rows: Indices, view: _View, starts: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Find patches of one keyframe in another: places (K, 2), covariances (K, 2, 2), and which are good."""
        s, features = self._settings.bundle, seen.keyframe.frame.features.select(rows)
        T = view.T_keyframe_first @ geometry.inverse(seen.T_keyframe_first)
        warps, scales = matching.warps(features, Uncertain.exactly(T), self._camera)
        found = refinement.align(
            features.patches, view.keyframe.frame.left, starts.astype(np.float32), warps,
            self._settings.odometry.matching.refine_iterations,
        )  # fmt: skip
        good = (found[:, 2] >= s.min_correlation) & (np.abs(found[:, :2] - starts).max(axis=1, initial=0.0) < s.gate)
        return found[:, :2].astype(np.float64), matching.place_noise(found, scales, self._settings.noise), good

    def _problem(self) -> tuple[bundle_adjustment.Problem, Indices]:
        """The window as a problem, and the track of each of its landmarks."""
        views = self._views
        index = {view.keyframe.number: i for i, view in enumerate(views)}
        feature = [np.flatnonzero(view.tracks >= 0) for view in views]
        keyframe = np.repeat(np.arange(len(views)), [len(f) for f in feature])
        track = np.concatenate([view.tracks[f] for view, f in zip(views, feature, strict=True)])
        rows = np.concatenate(feature)
        tracks, counts = np.unique(track, return_counts=True)
        newest = np.isin(tracks, views[-1].tracks)
        order = np.argsort(-(counts + len(views) * newest), kind="stable")[: self._settings.bundle.max_landmarks]
        tracks = np.sort(tracks[order])
        anchors = np.array([(index[self._anchors[t][0]], self._anchors[t][1]) for t in tracks.tolist()]).reshape(-1, 2)
        slot = np.searchsorted(tracks, track)
        slot[slot == len(tracks)] = 0
        measures = (tracks[slot] == track) & (keyframe != anchors[slot, 0]) if len(tracks) else np.zeros(0, dtype=bool)
        order = np.lexsort((keyframe[measures], slot[measures]))
        slot, keyframe, rows = (a[measures][order] for a in (slot, keyframe, rows))
        return bundle_adjustment.Problem(
            np.array([view.T_keyframe_first for view in views]),
            anchors[:, 0].copy(), *self._measured(anchors[:, 0], anchors[:, 1], at_corner=True),
            slot, keyframe, *self._measured(keyframe, rows, at_corner=False),
            views[0].keyframe.rectification.covariance,
        ), tracks  # fmt: skip

    def _measured(self, keyframe: Indices, feature: Indices, *, at_corner: bool) -> tuple[Array, Array]:
        """Measurements (N, 3) and covariances (N, 3, 3) of features (N,) of keyframes (N,) of the window.

        ``at_corner`` where a track begins; else at the places where its patch was found.
        """
        reference, pixel = self._views[0].keyframe.rectification, self._settings.noise.landmark_pixel
        uvd, covariances = np.zeros((len(feature), 3)), np.zeros((len(feature), 3, 3))
        for i, view in enumerate(self._views):
            rows = np.flatnonzero(keyframe == i)
            chosen, features = feature[rows], view.keyframe.frame.features
            measured = view.uvd[chosen]
            measured[:, 2] -= reference.disparity_error(measured[:, 0], self._camera)
            if at_corner:
                covariances[rows, :2, :2] = pixel**2 * np.eye(2)
            else:
                measured[:, 2] += features.slants[chosen] * (view.places[chosen, 1] - measured[:, 1])
                measured[:, :2] = view.places[chosen]
                covariances[rows, :2, :2] = view.noise[chosen]
            uvd[rows] = measured
            covariances[rows, 2, 2] = features.disparity_sigmas[chosen].astype(np.float64) ** 2
        return uvd, covariances

    def _adjustment(self, adjusted: bundle_adjustment.Adjusted, tracks: Indices) -> Adjustment:
        """What the newest keyframe learns."""
        view, reference = self._views[-1], self._views[0].keyframe.rectification
        noise, steps = self._settings.noise, len(self._views) - 1
        walked = Rectification(reference.mean, np.zeros((2, 2)))
        covariance = adjusted.covariance[-2:, -2:]
        for _ in range(steps):
            walked = walked.updated(np.zeros(2), walked.covariance, noise)
        rectification = Rectification(reference.mean + adjusted.rectification, covariance + walked.covariance)
        T_first_keyframe = geometry.inverse(view.T_keyframe_first)
        return Adjustment(
            keyframe=view.keyframe.number,
            T_odom_keyframe=geometry.normalize(self._T_odom_first @ T_first_keyframe),
            T_previous_keyframe=_motion(adjusted, steps),
            features=self._refined(view, adjusted, tracks, rectification),
            rectification=rectification,
            landmarks=len(tracks),
        )

    def _refined(
        self, view: _View, adjusted: bundle_adjustment.Adjusted, tracks: Indices, rectification: Rectification
    ) -> FeatureSet:
        """The newest keyframe's features with the disparities that the window gives them."""
        features, s = view.keyframe.frame.features, self._settings
        followed = np.flatnonzero(np.isin(view.tracks, tracks))
        slot = np.searchsorted(tracks, view.tracks[followed])
        seen, covariances = adjusted.newest[slot], adjusted.newest_covariances[slot]
        corner = view.uvd[followed]
        disparity = seen[:, 2] + features.slants[followed] * (corner[:, 1] - seen[:, 1])
        own = corner[:, 2] - rectification.disparity_error(corner[:, 0], self._camera)
        sigma = np.sqrt(covariances[:, 2, 2])
        own_sigma = features.disparity_sigmas[followed]
        good = np.isfinite(disparity) & (sigma < own_sigma) & (np.abs(disparity - own) < _AGREEMENT * own_sigma)
        followed, disparity, sigma = followed[good], disparity[good], sigma[good]
        measurements, sigmas = features.measurements.copy(), features.disparity_sigmas.copy()
        raw = disparity + rectification.disparity_error(measurements[followed, 0], self._camera)
        measurements[followed, 2] = measurements[followed, 0] - raw
        sigmas[followed] = sigma
        refined = replace(features, measurements=measurements, disparity_sigmas=sigmas)
        return triangulate(refined, self._camera, s.noise, rectification, s.preprocessing.min_disparity)


def _view(keyframe: WindowKeyframe, T_keyframe_first: Array) -> _View:
    """A keyframe in which no track is known yet."""
    measured = keyframe.frame.features.measurements.astype(np.float64)
    uvd = np.stack([measured[:, 0], measured[:, 1], measured[:, 0] - measured[:, 2]], axis=-1)
    count = len(uvd)
    return _View(
        keyframe, T_keyframe_first, uvd, np.full(count, -1, dtype=np.int64), uvd[:, :2].copy(), np.zeros((count, 2, 2))
    )


def _at_corners(view: _View, corners: NDArray[np.float32]) -> Indices:
    """Indices (K,) of the features at corners (K, 2), which are all among a keyframe's; these come in reading order."""
    stride = 1 << 16
    keys = view.uvd[:, 1].astype(np.int64) * stride + view.uvd[:, 0].astype(np.int64)
    return np.searchsorted(keys, corners[:, 1].astype(np.int64) * stride + corners[:, 0].astype(np.int64))


def _motion(adjusted: bundle_adjustment.Adjusted, last: int) -> Uncertain:
    """``T_previous_keyframe`` of the newest keyframe, with the correlation of the two poses' errors."""
    T = adjusted.T_keyframes_first[last - 1] @ geometry.inverse(adjusted.T_keyframes_first[last])
    Ad = geometry.adjoint(T)
    rows = slice(6 * (last - 1), 6 * last)
    by = -Ad
    if last == 1:
        return Uncertain(T, by @ adjusted.covariance[rows, rows] @ by.T)
    both = slice(6 * (last - 2), 6 * last)
    jacobian = np.concatenate([np.eye(6), by], axis=1)
    return Uncertain(T, jacobian @ adjusted.covariance[both, both] @ jacobian.T)
