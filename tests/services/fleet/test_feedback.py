"""What reports tell of maps: one bad metre says little, many say much, about that time of day and no other."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.environment.trouble import PRIOR_M
from common.messages import MapReport, RepeatReport
from services.fleet.feedback import SLOW, Feedback, trouble

MAP = "20260601T000000000000-r1-000000"
HOUR = 3_600_000_000_000


def told(hour, **values):
    return RepeatReport(id="a", robot="r1", environment="yard", stamp=hour * HOUR, maps=[MapReport(map=MAP, **values)])


def after(*reports):
    feedback = Feedback()
    for number, one in enumerate(reports):
        feedback.add(str(number), one)
    return np.array(feedback.trouble(MAP))


def test_who_has_told_nothing_has_no_trouble():
    assert Feedback().trouble(MAP) == ()


def test_one_bad_metre_says_little_and_a_hundred_say_much():
    assert after(told(9, metres=1, lost=1))[9] == pytest.approx(1 / (1 + PRIOR_M), abs=1e-4)
    assert after(told(9, metres=100, lost=100))[9] > 0.6
    assert after(told(9, metres=100, lost=0)).tolist() == []


def test_neighbouring_hours_share_it_around_midnight_and_the_other_side_of_the_day_does_not():
    found = after(told(24 * 20_000 + 23, metres=200, lost=200))
    assert found.argmax() == 23
    assert found[0] == pytest.approx(found[22], abs=1e-3)
    assert found[0] > 0.5
    assert found[11] < 0.01


def test_good_repeats_at_another_time_of_day_take_nothing_away():
    bad = told(9, metres=100, lost=50)
    alone, both = after(bad), after(bad, told(21, metres=1000, lost=0))
    assert both[9] == pytest.approx(alone[9], rel=0.05)
    assert after(bad, told(9, metres=1000, lost=0))[9] < 0.5 * alone[9]


def test_slow_frames_count_a_part_of_lost_metres():
    slow = after(told(9, metres=100, lost=0, frames=200, slow=200))
    assert slow == pytest.approx(SLOW * after(told(9, metres=100, lost=100)), abs=1e-4)


def test_a_report_is_counted_once_also_after_it_was_stored():
    feedback = Feedback()
    assert feedback.add("k", told(9, metres=10, lost=5)) == [MAP]
    again = Feedback.from_json(**json.loads(json.dumps(feedback.to_json())))
    assert again.add("k", told(9, metres=10, lost=5)) == []
    assert again.trouble(MAP) == feedback.trouble(MAP)


def test_sums_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="four rows"):
        Feedback.from_json([], {MAP: [[0.0] * 24]})


@given(
    st.lists(
        st.tuples(st.integers(0, 23), st.floats(0, 1e6), st.floats(0, 1e6), st.integers(0, 999), st.integers(0, 999)),
        max_size=5,
    )
)
def test_trouble_is_a_share_whatever_is_reported(reports):
    found = after(*(told(h, metres=a, lost=b, frames=f, slow=s) for h, a, b, f, s in reports))
    assert ((found >= 0.0) & (found <= 1.0)).all()
    assert trouble(np.zeros((4, 24))).tolist() == [0.0] * 24
