"""Which processes and data a state needs."""

from common.messages import StateName
from services.navigator.needs import listed, missing, silent

ALL = {"sensors", "estimator", "mapstore", "safety", "tracker", "planner"}


def test_nothing_is_missing_while_everybody_is_there():
    assert all(missing(state, ALL) == () for state in StateName)


def test_idle_and_paused_need_nobody():
    assert missing(StateName.IDLE, ()) == missing(StateName.PAUSED, ()) == ()


def test_following_goes_on_without_planner_and_store_but_not_without_the_tracker():
    assert missing(StateName.REPEAT_FOLLOW, ALL - {"planner", "mapstore"}) == ()
    assert missing(StateName.REPEAT_FOLLOW, ALL - {"tracker"}) == ("tracker",)


def test_a_player_stands_in_for_the_sensors():
    assert missing(StateName.TEACH_BRANCH, ALL - {"sensors"}) == ("sensors",)
    assert missing(StateName.TEACH_BRANCH, (ALL - {"sensors"}) | {"player"}) == ()


def test_what_flowed_may_not_stop_and_what_did_not_may_take_its_time_to_begin():
    def quiet(now, **arrivals):
        return silent(StateName.TEACH_BRANCH, 100.0, now, arrivals, 30.0, 2.0)

    assert quiet(101.0, odometry=99.9) == ()
    assert quiet(102.1, odometry=99.9) == ("odometry",)
    assert quiet(129.0) == ()
    assert quiet(131.0) == ("odometry",)
    assert quiet(131.0, odometry=130.0) == ()


def test_names_in_a_sentence():
    assert listed(["a"]) == "a"
    assert listed(["a", "b"]) == "a and b"
    assert listed(["a", "b", "c"]) == "a, b and c"
