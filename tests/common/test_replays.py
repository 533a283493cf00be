from common.bus.envelope import Source
from common.bus.replays import Asked


def test_a_question_is_answered_once_in_whatever_order_questions_come():
    asked, asker, other = Asked(), Source("r1", "operator", "aa"), Source("r1", "operator", "bb")
    assert asked.first_time(asker, 2)
    assert asked.first_time(asker, 1)
    assert asked.first_time(other, 1)
    assert not asked.first_time(asker, 1)
    assert not asked.first_time(asker, 2)


def test_a_made_up_number_keeps_nobody_from_being_heard():
    asked, asker = Asked(), Source("r1", "operator", "aa")
    assert asked.first_time(asker, 2**62)
    assert asked.first_time(asker, 1)


def test_many_questions_cost_bounded_memory():
    asked, asker = Asked(), Source("r1", "operator", "aa")
    assert all(asked.first_time(asker, number) for number in range(5000))
    assert not asked.first_time(asker, 4999)
    assert len(asked._heard) <= 4096
