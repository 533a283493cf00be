import numpy as np
import pytest

from services.tracker.limits import Drive, LimitError, Limits
from services.tracker.speed import CautionSettings, caution, speed_profile

LIMITS = Limits(speed=1.2, acceleration=0.5, deceleration=0.4, lateral_acceleration=0.6, turn_rate=0.8)


def profile(curvature):
    s = 0.1 * np.arange(len(curvature))
    return s, speed_profile(s, np.asarray(curvature), LIMITS)


def test_curves_are_driven_within_lateral_acceleration_and_turn_rate():
    curvature = np.concatenate([np.zeros(100), np.full(50, 1.0), np.zeros(100), np.full(50, -3.0), np.zeros(100)])
    _, speed = profile(curvature)
    assert (speed**2 * np.abs(curvature) <= LIMITS.lateral_acceleration + 1e-9).all()
    assert (speed * np.abs(curvature) <= LIMITS.turn_rate + 1e-9).all()
    assert speed.max() == pytest.approx(LIMITS.speed)


def test_every_speed_can_be_reached_and_braked_from():
    s, speed = profile(np.concatenate([np.zeros(60), np.full(10, 2.0), np.zeros(60)]))
    gain = np.diff(speed**2) / (2.0 * np.diff(s))
    assert gain.max() <= LIMITS.acceleration + 1e-9
    assert gain.min() >= -LIMITS.deceleration - 1e-9
    assert speed[-1] == 0.0


def test_full_speed_while_localized_and_slower_the_longer_it_is_lost():
    settings, known = CautionSettings(), 1e-4 * np.eye(6)
    assert caution(0.0, 0.0, known, settings) == 1.0
    shares = [caution(metres, 0.0, known, settings) for metres in (3.0, 5.0, 7.0, 100.0)]
    assert shares == sorted(shares, reverse=True)
    assert shares[-1] == pytest.approx(settings.slowest)
    assert caution(0.0, 5.0, known, settings) < 1.0
    assert caution(0.0, 0.0, 0.09 * np.eye(6), settings) < 1.0


@pytest.mark.parametrize("bad", [(np.nan, 0.0, 1.0), (0.0, np.inf, 1.0), (0.0, 0.0, np.nan)])
def test_slowest_for_what_is_not_finite(bad):
    metres, seconds, variance = bad
    assert caution(metres, seconds, variance * np.eye(6), CautionSettings()) == CautionSettings().slowest


@pytest.mark.parametrize("bad", [{"speed": 0.0}, {"deceleration": -1.0}, {"turn_rate": np.inf}, {"curvature": 0.0}])
def test_refuses_impossible_limits(bad):
    with pytest.raises(LimitError):
        Limits(**bad)


def test_ackermann_needs_a_curvature():
    with pytest.raises(LimitError):
        Limits(drive=Drive.ACKERMANN)
