"""What a person has chosen on the page, and the costs and the plan that follow from it."""

from __future__ import annotations

from dataclasses import dataclass

from common.environment import Costs, Model, Plan, Theta, map_costs, plan
from common.errors import GraphError
from services.console.fleet.snapshot import Maps

_NO_MAPS = "the environment has no maps that lead from a place to a place"
_TRIED = 60
"""Most places from which the farthest other one is sought."""


@dataclass(frozen=True, slots=True)
class Question:
    """When, from where to where, and what matters.

    Attributes:
        at_hours: the time of the drive, hours since the Unix epoch.
        theta: the weights of (3.6).
        per_metre: whether likeness and drift count for each metre.
        start, goal: places.
    """

    at_hours: float
    theta: Theta
    per_metre: bool = False
    start: str = ""
    goal: str = ""


@dataclass(frozen=True, slots=True)
class Answer:
    """What every map costs, and the plan; where there is none, ``reason`` says why in a sentence."""

    costs: Costs
    plan: Plan | None
    reason: str = ""

    @property
    def chosen(self) -> list[int]:
        """The numbers of the plan's maps, in order."""
        return [] if self.plan is None else self.plan.edges


def answer(maps: Maps, model: Model, question: Question) -> Answer:
    """The costs of ``vtr env cost`` and the plan of ``vtr env plan``."""
    if not (question.start and question.goal):
        costs = map_costs(maps.table, model, question.at_hours, question.theta, per_metre=question.per_metre)
        return Answer(costs, None, "choose where the drive begins and where it ends" if len(maps.table) else _NO_MAPS)
    try:
        made = plan(
            maps.table,
            maps.network,
            model,
            question.start,
            question.goal,
            question.at_hours,
            question.theta,
            per_metre=question.per_metre,
        )
    except GraphError as error:
        costs = map_costs(maps.table, model, question.at_hours, question.theta, per_metre=question.per_metre)
        return Answer(costs, None, str(error))
    return Answer(made.costs, made)


def farthest_ends(maps: Maps) -> tuple[str, str]:
    """Two places that a way leads between over as many maps as between any: what a page shows at first."""
    best, ends = 0, ("", "")
    for goal, name in enumerate(maps.table.places[:_TRIED]):
        hops = maps.network.hops(goal)
        start = int(hops.argmax())
        if hops[start] > best:
            best, ends = int(hops[start]), (maps.table.places[start], name)
    return ends
