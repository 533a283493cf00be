from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.estimator.coverage import dropouts, failure_reduction, measure, pooled, survival

DRIVES = st.lists(st.tuples(st.booleans(), st.floats(0.0, 5.0)), min_size=1, max_size=60)


def one_by_one(success, distance):
    """The definition, frame by frame: a dropout begins at a failure and ends at the next success."""
    lengths, begun = [], None
    for good, metres in zip(success, distance, strict=True):
        if not good and begun is None:
            begun = metres
        if good and begun is not None:
            lengths.append(metres - begun)
            begun = None
    return lengths if begun is None else [*lengths, distance[-1] - begun]


def test_a_dropout_lasts_from_its_failure_to_the_next_success():
    success = [True, False, False, True, True, False, True]
    assert dropouts(success, [0.0, 1.0, 2.0, 4.0, 5.0, 6.0, 6.5]).tolist() == [3.0, 0.5]


def test_a_drive_that_starts_or_ends_lost_counts_what_was_driven():
    assert dropouts([False, False, True, False, False], [0.0, 1.0, 2.0, 3.0, 5.0]).tolist() == [2.0, 2.0]
    assert dropouts([False, False], [0.0, 7.0]).tolist() == [7.0]
    assert dropouts([True, True], [0.0, 7.0]).tolist() == []
    assert dropouts([], []).tolist() == []


@given(DRIVES)
def test_dropouts_are_those_of_the_definition(drive):
    success = [good for good, _ in drive]
    distance = np.cumsum([step for _, step in drive])
    assert dropouts(success, distance).tolist() == pytest.approx(one_by_one(success, distance))


@given(DRIVES, DRIVES)
def test_several_drives_are_measured_as_one(first, second):
    parts = [measure([g for g, _ in d], np.cumsum([s for _, s in d])) for d in (first, second)]
    both = pooled(parts)
    assert both.frames == len(first) + len(second)
    assert both.fraction == pytest.approx(np.mean([g for g, _ in first + second]))
    assert len(both.dropouts) == sum(len(part.dropouts) for part in parts)
    assert both.metres == pytest.approx(sum(part.metres for part in parts))


def test_how_likely_a_loss_lasts_longer():
    lost = [2.0, 12.0, 4.0, 30.0]
    assert survival(lost, [0.0, 2.0, 10.0, 29.9, 30.0]).tolist() == [1.0, 0.75, 0.5, 0.25, 0.0]
    assert survival([], [0.0, 1.0]).tolist() == [0.0, 0.0]
    success = np.ones(101, dtype=bool)
    success[10:30] = success[50:53] = False
    coverage = measure(success, np.arange(101.0))
    assert coverage.beyond(10.0) == 0.5
    assert coverage.per_kilometre(10.0) == pytest.approx(10.0)
    assert coverage.fraction == pytest.approx(78 / 101)


def test_the_paper_s_average_cuts_failures_by_a_third():
    assert failure_reduction(0.9217, 0.9468) == pytest.approx(0.32, abs=0.005)
    assert failure_reduction(1.0, 1.0) is None
    assert failure_reduction(0.5, 0.25) == pytest.approx(-0.5)


def test_what_is_no_drive_is_refused():
    with pytest.raises(ValueError, match="one distance a frame"):
        dropouts([True], [0.0, 1.0])
    with pytest.raises(ValueError, match="decrease"):
        dropouts([True, True], [1.0, 0.0])
    assert measure([], []).fraction == 0.0
    assert pooled([]).beyond(1.0) == 0.0
