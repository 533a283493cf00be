"""Which points are in the way, and for how long."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.obstacles.zones import Found, Look, Watch, ZoneError, ZoneSettings, area, inside, look

SQUARE = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
ARROW = ((0.0, 0.0), (2.0, 1.0), (0.0, 2.0), (1.0, 1.0))
SETTINGS = ZoneSettings(points=3, looks=2, clear_s=1.0)


def cloud(x, y=0.0, z=0.5, count=10):
    return np.tile([x, y, z], (count, 1)).astype(float)


@given(st.floats(-3, 3), st.floats(-3, 3))
def test_a_square_holds_what_lies_between_its_sides(x, y):
    assert inside(np.array([[x, y]]), SQUARE)[0] == (0 <= x < 2 and 0 <= y < 2)


def test_a_polygon_may_have_a_notch():
    points = np.array([[0.5, 1.0], [1.5, 1.0], [0.3, 0.25]])
    assert inside(points, ARROW).tolist() == [False, True, True]
    assert area(ARROW) == pytest.approx(1.0)


@pytest.mark.parametrize("zones", [{"stop": ((0, 0), (1, 0))}, {"slow": ((0, 0), (1, 1), (2, 2))}, {"lowest": 3.0}])
def test_a_zone_that_is_none_is_refused(zones):
    with pytest.raises(ZoneError):
        ZoneSettings(**zones)


@pytest.mark.parametrize(
    ("points", "stop", "slow"),
    [
        (cloud(1.0), 10, 10),
        (cloud(2.5), 0, 10),
        (cloud(5.0), 0, 0),
        (cloud(1.0, y=0.6), 0, 10),
        (cloud(1.0, z=0.1), 0, 0),
        (cloud(1.0, z=2.5), 0, 0),
        (cloud(np.nan), 0, 0),
    ],
    ids=["before it", "farther", "far", "beside", "ground", "overhead", "nothing"],
)
def test_points_count_where_they_stand_in_a_zone(points, stop, slow):
    found = look(points, SETTINGS)
    assert (found.stop, found.slow) == (stop, slow)
    assert (found.nearest is None) == (slow == 0)


def test_the_nearest_is_told():
    assert look(np.concatenate([cloud(2.0), cloud(1.2)]), SETTINGS).nearest == pytest.approx(1.2)


SOMETHING, NEAR, NOTHING = Look(9, 9, 1.0), Look(0, 9, 3.0), Look(0, 0, None)


def test_something_counts_when_it_was_seen_twice_and_is_gone_after_a_second():
    watch = Watch(SETTINGS)
    assert watch.see(0.0, SOMETHING) is Found.CLEAR
    assert watch.see(0.1, NOTHING) is Found.CLEAR, "a single look may be wrong"
    assert watch.see(0.2, SOMETHING) is Found.CLEAR
    assert watch.see(0.3, SOMETHING) is Found.STOP
    assert watch.see(0.4, NOTHING) is Found.STOP
    assert watch.see(1.2, NOTHING) is Found.STOP
    assert watch.see(1.4, NOTHING) is Found.CLEAR


def test_what_flickers_stays():
    watch = Watch(SETTINGS)
    watch.see(0.0, SOMETHING)
    for k in range(1, 60):
        assert watch.see(0.1 * k, SOMETHING if k % 4 < 2 else NOTHING) is Found.STOP


def test_something_that_goes_farther_away_slows_the_robot_down_still():
    watch = Watch(SETTINGS)
    for k in range(3):
        watch.see(0.1 * k, SOMETHING)
    found = [watch.see(0.3 + 0.1 * k, NEAR) for k in range(15)]
    assert (found[0], found[-1]) == (Found.STOP, Found.SLOW)
