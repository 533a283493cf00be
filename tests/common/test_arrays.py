from __future__ import annotations

import numpy as np
import pytest

from common.arrays import ArraySpec


def test_a_right_array_is_passed_on_uncopied():
    for spec, array in [
        (ArraySpec("<f8", (None, 3)), np.zeros((4, 3))),
        (ArraySpec("|u1"), np.zeros((2, 2, 3), np.uint8)),
        (ArraySpec("<f8", (4, 4), rigid=True), np.eye(4)),
        (ArraySpec(), np.array(3, np.int32)),
    ]:
        assert spec.check(array) is array


def test_lists_of_numbers_become_an_array_where_the_type_is_known():
    assert ArraySpec("<f8", (3,)).check([1, 2, 3]).dtype == np.float64
    with pytest.raises(ValueError, match="expected an array"):
        ArraySpec().check([1, 2, 3])


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("spec", "value", "reason"),
    [
        (ArraySpec("<f8"), np.zeros(3, np.float32), "type <f8"),
        (ArraySpec("<f8", (3,)), np.zeros((3, 1)), "shape"),
        (ArraySpec("<f8", (None, 3)), np.zeros((3, 4)), "shape"),
        (ArraySpec("<f8"), np.array([1, np.nan]), "NaN"),
        (ArraySpec(), np.array([np.inf], np.float32), "infinity"),
        (ArraySpec(), np.array([object()]), "cannot travel"),
        (ArraySpec(), np.array(["text"]), "cannot travel"),
        (ArraySpec(), np.zeros(2, ">f8"), "cannot travel"),
        (ArraySpec("<f8", (4, 4), rigid=True), 2 * np.eye(4), "rigid"),
        (ArraySpec("<f8", (4, 4), rigid=True), np.full((4, 4), np.nan), "rigid"),
        (ArraySpec("<f8"), "text", "expected an array"),
        (ArraySpec("<f8"), None, "expected an array"),
    ],
)
def test_a_wrong_value_is_refused_with_its_reason(spec, value, reason):
    with pytest.raises(ValueError, match=reason):
        spec.check(value)
