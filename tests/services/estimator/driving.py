"""A drive as the estimator's parts meet it: steps of an odometry whose motion is known."""

import numpy as np

from common import geometry
from common.geometry import Uncertain
from services.estimator.pipeline import Step

FRAME_NS = 100_000_000


class Drive:
    """Makes steps, one frame after the other; every so many frames a new keyframe begins."""

    def __init__(self, *, keyframe_every=1, variance=1e-6):
        self._every = keyframe_every
        self._covariance = np.diag([variance] * 6)
        self._T_keyframe_live = np.eye(4)
        self.frames = 0

    def on(self, motion, *, success=True, live=None):
        """The next step: a twist, or a transform ``T_last_live``."""
        motion = np.asarray(motion, dtype=np.float64)
        T_last_live = motion if motion.shape == (4, 4) else geometry.exp(motion)
        if self.frames % self._every == 0:
            self._T_keyframe_live = np.eye(4)
        self._T_keyframe_live = self._T_keyframe_live @ T_last_live
        step = Step(
            stamp=self.frames * FRAME_NS,
            T_last_live=Uncertain(T_last_live, self._covariance),
            keyframe=self.frames // self._every,
            T_keyframe_live=Uncertain(self._T_keyframe_live, self._covariance),
            twist=np.zeros(6),
            success=success,
            inliers=100,
            reason="",
            live=live,
        )
        self.frames += 1
        return step
