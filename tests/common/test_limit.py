from common.limit import Limit


def test_the_same_passes_once_a_period_and_tells_how_often_it_came():
    limit = Limit(1.0, 10)
    assert [limit.passes("a", now) for now in (0.0, 0.1, 0.2, 1.1)] == [1, 0, 0, 3]
    assert limit.passes("b", 1.1) == 1


def test_all_together_are_limited_too_in_bounded_memory():
    limit = Limit(1.0, 5)
    assert sum(limit.passes(n, 0.0) for n in range(10_000)) == 5
    assert limit.passes("another", 1.0) == 1
    assert len(limit._silent) <= 256
    assert len(limit._last) <= 256
