"""Stretches that the operator has blocked or slowed down, as the store keeps them."""

import random

import pytest

from common.errors import GraphError
from common.messages import GraphQuery, Restriction
from services.mapstore.store import Store
from tests.services.mapstore.graphs import drive, map_id

YARD = GraphQuery(environment="yard")
VERTICES = 12


@pytest.fixture
def taught(store: Store) -> Store:
    for commit in drive(0, VERTICES):
        store.commit(commit)
    return store


def speeds(store: Store) -> list[float | None]:
    """The restriction at each vertex, None where there is none."""
    found: list[float | None] = [None] * VERTICES
    for one in store.topology(YARD).restrictions:
        for index in range(one.first, one.last + 1):
            assert found[index] is None, "no vertex is restricted twice"
            found[index] = one.speed
    return found


def test_the_last_word_on_each_vertex_holds(taught: Store) -> None:
    expected: list[float | None] = [None] * VERTICES
    chance = random.Random(3)  # noqa: S311, chance for tests
    for _ in range(200):
        first, last = sorted(chance.choices(range(VERTICES), k=2))
        speed = chance.choice([None, 0.0, 0.4])
        taught.restrict(Restriction(map=map_id(0), first=first, last=last, speed=speed))
        expected[first : last + 1] = [speed] * (last + 1 - first)
        assert speeds(taught) == expected


def test_what_is_blocked_and_why_is_said(taught: Store) -> None:
    told = taught.restrict(Restriction(map=map_id(0), first=2, last=4, reason="a lorry"))
    assert told.text == f"{map_id(0)} from 2 to 4 is blocked"
    assert taught.topology(YARD).restrictions[0].reason == "a lorry"
    told = taught.restrict(Restriction(map=map_id(0), first=0, last=VERTICES - 1, speed=0.5))
    assert told.text.endswith("is limited to 0.5 m/s")


def test_a_stretch_that_is_not_there_is_refused_and_changes_nothing(taught: Store) -> None:
    taught.restrict(Restriction(map=map_id(0), first=2, last=4))
    for wrong, sentence in (
        (Restriction(map=map_id(0), first=2, last=VERTICES), "has vertices 0 to 11"),
        (Restriction(map=map_id(1), first=0, last=0), "no map"),
    ):
        with pytest.raises(GraphError, match=sentence):
            taught.restrict(wrong)
    assert speeds(taught)[2:5] == [0.0] * 3


def test_a_removed_map_takes_its_restrictions_with_it(taught: Store) -> None:
    taught.restrict(Restriction(map=map_id(0), first=2, last=4))
    taught.remove(GraphQuery(map=map_id(0)))
    for commit in drive(0, VERTICES):
        taught.commit(commit)
    assert taught.topology(YARD).restrictions == []
