"""Dead reckoning: the live robot in the frame of a reference, by the odometry since.

Odometry measures every frame against a keyframe. The errors of frames that share a keyframe have much in common, so
their steps must not be added up as if each were new: the covariance grows with the keyframes between, not the frames.
What bundle adjustment says later of the motion up to the present keyframe takes the place of what was measured then.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from common import geometry
from common.geometry import Array, Uncertain
from services.estimator.pipeline import Step

_FRESH = 0.5
"""Part of the covariance against a keyframe that is the live frame's own: two equal images measure each landmark."""


class DeadReckoning:
    """``T_reference_live`` with covariance; the reference is where :meth:`start` was called last."""

    def __init__(self) -> None:
        self._keyframe: int | None = None
        self._T_keyframe_live = Uncertain.identity()
        self._T_reference_start = Uncertain.identity()
        self._T_keyframe_start = Uncertain.identity()
        self._moved = False
        self._before: tuple[Uncertain, Uncertain] | None = None

    def start(self, T_reference_live: Uncertain | None = None) -> None:
        """Makes the live frame the reference, or another frame in which the live one is known."""
        self._T_reference_start = T_reference_live or Uncertain.identity()
        self._T_keyframe_start = self._T_keyframe_live
        self._moved = False
        self._before = None

    def move(self, step: Step[Any]) -> None:
        """Takes the live frame on by a frame's odometry; the first frame ever is the one that :meth:`start` meant."""
        if self._keyframe is None:
            self._T_keyframe_start = step.T_keyframe_live
        elif step.keyframe != self._keyframe:
            follows = self._moved and step.keyframe == self._keyframe + 1
            self._before = (self._T_reference_start, self._T_keyframe_start) if follows else None
            # The new keyframe is the frame before this one.
            self._T_reference_start = self.T_reference_live
            self._T_keyframe_start = Uncertain.identity()
        if step.T_previous_keyframe is not None and self._before is not None:
            T_reference_start, T_keyframe_start = self._before
            self._T_reference_start = T_reference_start @ _between(T_keyframe_start, step.T_previous_keyframe)
            self._before = None
        self._moved = self._keyframe is not None
        self._keyframe = step.keyframe
        self._T_keyframe_live = step.T_keyframe_live

    @property
    def T_reference_live(self) -> Uncertain:
        """The live frame in the reference's."""
        if not self._moved:
            return self._T_reference_start
        return self._T_reference_start @ _between(self._T_keyframe_start, self._T_keyframe_live)


def _between(T_keyframe_a: Uncertain, T_keyframe_b: Uncertain) -> Uncertain:
    """``T_a_b`` of two frames that were measured against one keyframe.

    What the keyframe's own noise made of the error is the same in both but for what it has grown by in between.
    """
    T_a_keyframe = geometry.inverse(T_keyframe_a.T)
    grown = _positive(T_keyframe_b.covariance - T_keyframe_a.covariance)
    covariance = _FRESH * (T_keyframe_a.covariance + T_keyframe_b.covariance) + (1.0 - _FRESH) * grown
    Ad = geometry.adjoint(T_a_keyframe)
    return Uncertain(T_a_keyframe @ T_keyframe_b.T, Ad @ covariance @ Ad.T)


def _positive(symmetric: Array) -> Array:
    """The nearest positive semidefinite matrix."""
    values, vectors = np.linalg.eigh(symmetric)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)
