"""What the wheels reported between the moments of two frames, and by how much their clock is late."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common import geometry
from services.sensors.calibration.errors import CalibrationError

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

LONGEST_GAP_S = 0.5
"""Between two reports that are further apart nobody knows how the wheels turned."""
MAX_DELAY_S = 0.4
"""Greatest delay that is looked for."""

_STEP_S = 0.01
_MIN_MOTIONS = 20
_ALIKE = 0.5
"""Least correlation of turns that are the same."""


@dataclass(frozen=True, slots=True)
class WheelLog:
    """What the wheels reported.

    Attributes:
        stamps_ns: (M,) increasing, nanoseconds.
        v, w: (M,) speeds, m/s, and turn rates, rad/s, each at its stamp.
    """

    stamps_ns: Stamps
    v: Array
    w: Array

    @classmethod
    def of(cls, reports: list[tuple[int, float, float]]) -> WheelLog:
        """From reports of stamp, speed and turn rate in any order; of several with one stamp the first counts.

        Raises:
            CalibrationError: there are none to speak of.
        """
        if len(reports) < 2:
            raise CalibrationError("the wheels report nothing: somebody has to publish sensor/odometry")
        stamps, first = np.unique(np.array([stamp for stamp, _, _ in reports], dtype=np.int64), return_index=True)
        speeds = np.array([(v, w) for _, v, w in reports])[first]
        return cls(stamps, speeds[:, 0], speeds[:, 1])

    def motions(self, before_ns: Stamps, after_ns: Stamps, delay: float = 0.0) -> tuple[Array, NDArray[np.bool_]]:
        """Motions (N, 3) from moments to later ones: x and y, metres, and the turn, in the frame before.

        ``delay`` (s) is how much later than the frames' the wheels' stamps are. Between reports speeds change evenly.
        The second answer (N,) says which motions the reports cover; the others are zero.
        """
        # Seconds since the first report: nanoseconds since the epoch have too many digits for a float.
        origin = self.stamps_ns[0]
        reported = (self.stamps_ns - origin) * 1e-9
        begin, end = ((stamps - origin) * 1e-9 + delay for stamps in (before_ns, after_ns))
        times = np.unique(np.concatenate([reported, begin, end]))
        v, w = np.interp(times, reported, self.v), np.interp(times, reported, self.w)
        seconds = np.diff(times)
        turn, chord = seconds * (w[1:] + w[:-1]) / 2.0, seconds * (v[1:] + v[:-1]) / 2.0
        heading = np.concatenate([[0.0], np.cumsum(turn)])
        # The chord of an arc lies at half of its angle; np.sinc has pi in it.
        chord, middle = chord * np.sinc(turn / (2.0 * np.pi)), heading[:-1] + turn / 2.0
        x, y = (np.concatenate([[0.0], np.cumsum(chord * axis)]) for axis in (np.cos(middle), np.sin(middle)))
        a, b = np.searchsorted(times, begin), np.searchsorted(times, end)
        dx, dy, c, s = x[b] - x[a], y[b] - y[a], np.cos(heading[a]), np.sin(heading[a])
        motions = np.column_stack([c * dx + s * dy, c * dy - s * dx, heading[b] - heading[a]])
        covered = self._covered(reported, begin, end)
        return np.where(covered[:, None], motions, 0.0), covered

    @staticmethod
    def _covered(reported: Array, begin: Array, end: Array) -> NDArray[np.bool_]:
        """Whether reports lie around and within intervals, none of their gaps being too long."""
        gaps = np.concatenate([[0], np.cumsum(np.diff(reported) > LONGEST_GAP_S)])
        first = np.searchsorted(reported, begin, side="right") - 1
        last = np.searchsorted(reported, end, side="left")
        inside = (first >= 0) & (last < len(reported))
        return np.asarray(inside & (gaps[np.minimum(last, len(reported) - 1)] == gaps[np.maximum(first, 0)]))


def find_delay(log: WheelLog, before_ns: Stamps, after_ns: Stamps, camera_motions: Array) -> float:
    """By how much later the wheels' stamps are than the frames', seconds: where both turn alike most.

    ``camera_motions`` (N, 4, 4) are between the moments (N,).

    Raises:
        CalibrationError: too few motions, or there is no such delay within :data:`MAX_DELAY_S`.
    """
    if len(camera_motions) < _MIN_MOTIONS:
        raise CalibrationError(
            f"the camera's motion is known between {len(camera_motions)} frames alone: drive slowly, in a place with "
            "texture and light"
        )
    turns = geometry.so3_log(camera_motions[:, :3, :3])
    # On a plane all turns are about one axis, whatever the mounting.
    axis = np.linalg.eigh(turns.T @ turns)[1][:, -1]
    delays = np.arange(-MAX_DELAY_S, MAX_DELAY_S + _STEP_S / 2, _STEP_S)
    likeness = np.array([_likeness(log, before_ns, after_ns, turns @ axis, delay) for delay in delays])
    best = int(np.argmax(likeness))
    if likeness[best] < _ALIKE:
        # A drive that turns too little, or never otherwise, tells no delay; the check of the drive says so.
        return 0.0
    if best in (0, len(delays) - 1):
        raise CalibrationError(
            f"the wheels' stamps are more than {MAX_DELAY_S:g} s off the frames': let one clock stamp both"
        )
    below, here, above = likeness[best - 1 : best + 2]
    bend = below - 2.0 * here + above
    return float(delays[best] + (0.5 * (below - above) / bend * _STEP_S if bend < 0.0 else 0.0))


def _likeness(log: WheelLog, before_ns: Stamps, after_ns: Stamps, turns: Array, delay: float) -> float:
    """Correlation of two turns, whatever their sign: the axis has none."""
    motions, covered = log.motions(before_ns, after_ns, delay)
    a, b = turns[covered], motions[covered, 2]
    if covered.sum() < _MIN_MOTIONS or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return 0.0
    return float(abs(np.corrcoef(a, b)[0, 1]))
