"""What wheels drove between the moments of frames, and how late their stamps are."""

import numpy as np
import pytest

from common import geometry
from services.sensors.calibration.drive import Seen, join
from services.sensors.calibration.errors import CalibrationError
from services.sensors.calibration.mounting import mount
from services.sensors.calibration.wheels import WheelLog, find_delay

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def log(seconds=20.0, rate=50.0, late=0.0, gap=(0.0, 0.0)):
    """Reports of a drive that turns to one side and the other."""
    t = np.arange(0.0, seconds, 1 / rate)
    t = t[(t < gap[0]) | (t >= gap[1])]
    return WheelLog(START + np.round((t + late) * SECOND).astype(np.int64), 0.5 + 0 * t, turn_rate(t))


def turn_rate(t):
    return 0.8 * np.sin(0.9 * t)


def moments(seconds=20.0, rate=10.0):
    stamps = START + np.round(np.arange(0.5, seconds - 0.5, 1 / rate) * SECOND).astype(np.int64)
    return stamps[:-1], stamps[1:]


def camera_motions(before, after):
    """Of a camera that looks ahead, and so turns about its y."""
    heading = [0.8 / 0.9 * (1 - np.cos(0.9 * (s - START) / SECOND)) for s in (before, after)]
    turns = np.zeros((len(before), 3))
    turns[:, 1] = heading[0] - heading[1]
    return geometry.transform(geometry.so3_exp(turns), np.zeros(3))


def test_a_circle_closes():
    t = np.arange(0.0, 4.1, 0.02)
    wheels = WheelLog(START + np.round(t * SECOND).astype(np.int64), 1.0 + 0 * t, np.full_like(t, np.pi / 2))
    quarter = START + np.array([0, 1, 2, 3, 4]) * SECOND
    motions, covered = wheels.motions(quarter[:-1], quarter[1:])
    assert covered.all()
    radius = 2 / np.pi
    np.testing.assert_allclose(motions, np.tile([radius, radius, np.pi / 2], (4, 1)), atol=1e-6)


def test_moments_between_reports_are_interpolated():
    before, after = moments()
    motions, _ = log(rate=20.0).motions(before + 7_000_000, after + 7_000_000)
    exact = 0.8 / 0.9 * (np.cos(0.9 * (before - START) / SECOND) - np.cos(0.9 * (after - START) / SECOND))
    assert np.abs(motions[:, 2].sum() - exact.sum()) < 0.01


def test_what_no_report_covers_is_left_out():
    before, after = moments()
    _, covered = log(gap=(5.0, 7.0)).motions(before, after)
    t = (before - START) / SECOND
    assert not covered[(t > 5.0) & (t < 6.8)].any()
    assert covered[(t < 4.8) | (t > 7.1)].all()


@pytest.mark.parametrize("late", [-0.12, 0.0, 0.073])
def test_a_late_clock_is_found(late):
    before, after = moments()
    assert find_delay(log(late=late), before, after, camera_motions(before, after)) == pytest.approx(late, abs=0.005)


def test_a_straight_line_has_no_delay_and_no_mounting():
    """Noise alone is alike at some delay, and at which says nothing."""
    before, after = moments()
    rng = np.random.default_rng(2)
    motions = geometry.exp(rng.normal([0.0, 0.0, 0.05, 0.0, 0.0, 0.0], 0.002, (len(before), 6)))
    reports = log()
    straight = WheelLog(reports.stamps_ns, reports.v, rng.normal(0.0, 0.005, len(reports.v)))
    pieces = [Seen(int(a), int(b), T) for a, b, T in zip(before, after, motions, strict=True)]
    drive = join(pieces, len(before) + 1, straight)
    assert drive.delay == 0.0
    with pytest.raises(CalibrationError, match="drive a figure of eight"):
        mount(drive.camera_motions, drive.wheel_motions)


def seen(before, after):
    return [Seen(int(a), int(b), T) for a, b, T in zip(before, after, camera_motions(before, after), strict=True)]


def test_what_has_too_little_in_common_is_refused():
    before, after = moments()
    drive = join(seen(before, after), len(before) + 1, log(late=0.1))
    assert "100 ms later" in drive.warnings[0]
    np.testing.assert_allclose(
        drive.wheel_motions[:, 2], -geometry.so3_log(drive.camera_motions[:, :3, :3])[:, 1], atol=2e-3
    )
    with pytest.raises(CalibrationError, match="wheels report nothing"):
        WheelLog.of([])
    with pytest.raises(CalibrationError, match="no stereo frames"):
        join([], 0, log())
    with pytest.raises(CalibrationError, match="drive slowly"):
        join(seen(before[:30], after[:30]), len(before), log())
    with pytest.raises(CalibrationError, match="same clock"):
        join(seen(before, after), len(before) + 1, log(gap=(4.0, 15.0)))
    with pytest.raises(CalibrationError, match=r"more than 0\.4 s off"):
        join(seen(before, after), len(before) + 1, log(late=0.8))
