"""Capture from video files: pairs in step, halves in order, and a sentence for whatever a device fails at."""

from itertools import pairwise

import numpy as np
import pytest

from services.sensors.capture import CaptureError, Format, StereoCapture, captured_at
from tests.services.sensors.video import numbered, write_video


def levels(pair):
    return round(float(pair.left.mean())), round(float(pair.right.mean()))


def captured(capture, count):
    pairs = []
    for _ in range(count):
        capture.grab()
        pairs.append(capture.retrieve())
    return pairs


def test_two_devices_deliver_in_step(tmp_path):
    left = write_video(tmp_path / "left.avi", numbered(4), 100.0)
    right = write_video(tmp_path / "right.avi", numbered(4, offset=5), 100.0)
    with StereoCapture((str(left), str(right)), Format()) as capture:
        pairs = captured(capture, 4)
        assert [levels(pair) for pair in pairs] == [(0, 5), (10, 15), (20, 25), (30, 35)]
        assert all(a.stamp_ns < b.stamp_ns for a, b in pairwise(pairs))
        assert pairs[0].left.shape == (48, 64, 3)
        with pytest.raises(CaptureError, match=r"left\.avi delivers no images"):
            capture.grab()


@pytest.mark.parametrize("right_first", [False, True])
def test_one_device_delivers_both_halves(tmp_path, right_first):
    both = [np.hstack([left, left + 5]) for left in numbered(2)]
    path = write_video(tmp_path / "both.avi", both, 100.0)
    with StereoCapture((str(path),), Format(), right_first=right_first) as capture:
        first = captured(capture, 2)[1]
    assert levels(first) == ((15, 10) if right_first else (10, 15))
    assert first.left.flags.c_contiguous


def test_colours_are_rgb(tmp_path):
    red = np.zeros((48, 64, 3), np.uint8)
    red[:, :, 0] = 200
    path = write_video(tmp_path / "red.avi", [red, red], 100.0)
    with StereoCapture((str(path),), Format()) as capture:
        pair = captured(capture, 1)[0]
    assert pair.left.reshape(-1, 3).mean(axis=0) == pytest.approx([200, 0, 0], abs=4)


def test_a_device_that_is_not_there_is_named(tmp_path):
    with pytest.raises(CaptureError, match=r"no camera .*nowhere\.avi"):
        StereoCapture((str(tmp_path / "nowhere.avi"),), Format())


def test_a_drivers_time_of_capture_is_used_where_it_is_of_the_monotonic_clock():
    assert captured_at(1000_250.0, 1000.270, 5_000_000_000) == 5_000_000_000 - 20_000_000
    assert captured_at(120.0, 1000.270, 5_000_000_000) is None
    assert captured_at(1000_300.0, 1000.270, 5_000_000_000) is None


class Stub:
    """A device with times of its own."""

    is_live, rate, source = True, 20.0, "stub"

    def __init__(self, *stamps_ms, width=64):
        self.stamps = list(stamps_ms)
        self.width = width
        self.now = 0

    def grab(self):
        self.now = self.stamps.pop(0)
        return self.now * 1_000_000

    def retrieve(self):
        return np.full((48, self.width), self.now % 256, np.uint8)

    def close(self):
        pass


@pytest.mark.parametrize("right_first", [False, True])
def test_a_camera_that_is_a_frame_behind_catches_up(monkeypatch, right_first):
    devices = {0: Stub(0, 50, 100), 1: Stub(53, 103)}
    monkeypatch.setattr("services.sensors.capture.Device", lambda source, _wanted: devices[source])
    with StereoCapture((0, 1), Format(), right_first=right_first) as capture:
        pair = captured(capture, 1)[0]
    assert pair.skew_s == pytest.approx(-0.003 if right_first else 0.003)
    assert pair.stamp_ns == (53 if right_first else 50) * 1_000_000
    assert levels(pair) == ((53, 50) if right_first else (50, 53))


def test_an_image_that_cannot_be_halved_is_refused(monkeypatch):
    monkeypatch.setattr("services.sensors.capture.Device", lambda _source, _wanted: Stub(0, width=63))
    with StereoCapture((0,), Format()) as capture, pytest.raises(CaptureError, match="63x48"):
        captured(capture, 1)
