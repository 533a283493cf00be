"""The matrix of a route: rows enter when they tell of all that is there, and the oldest maps leave a full one."""

import numpy as np
import pytest

from services.fleet.groups import Along, Group, Kind
from tests.services.fleet.shared import image, metadata

KEY = (Kind("small", 2, 3, 16, 5333), "a", "b")


def value(one, other):
    return 1.0 if one == other else 1.0 / (1.0 + abs(int(one[1:]) - int(other[1:])))


def entered(group, name, names=None):
    names = [*group.ids, name] if names is None else names
    return group.add(name, float(name[1:]), names, np.array([value(name, other) for other in names]))


def test_a_group_grows_to_its_limit_and_lets_the_oldest_go():
    group = Group(KEY, 12)
    for k in range(30):
        assert entered(group, f"m{k:02d}")
    names, hours, matrix = group.matrix()
    assert names == [f"m{k:02d}" for k in range(18, 30)]
    assert hours.tolist() == list(range(18, 30))
    assert matrix.tolist() == [[value(a, b) for b in names] for a in names]
    assert group.matrix(3)[0] == names[-3:]


def test_a_row_that_lacks_a_map_does_not_enter():
    group = Group(KEY, 5)
    assert entered(group, "m01")
    assert not entered(group, "m02", ["m02"])
    assert entered(group, "m02", ["m00", "m01", "m02"])
    assert len(group) == 2


def test_maps_that_are_gone_leave():
    group = Group(KEY, 5)
    for k in range(4):
        entered(group, f"m{k:02d}")
    group.remove({"m01", "m77"})
    assert group.ids == ["m00", "m02", "m03"]
    assert np.isfinite(group.matrix()[2]).all()


def test_images_of_different_kinds_along_one_map_are_no_map_to_compare():
    other = image(1.0, 20.0).model_copy(update={"name": "another"})
    with pytest.raises(ValueError, match="different kinds"):
        Along.of(metadata(1.0, images=[image(1.0, 0.0), other]))
    assert Along.of(metadata(1.0, images=[])) is None
