"""What a browser asks, checked."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, ValidationError

from common.environment import Theta
from common.ids import NAME_PATTERN, PLACE_PATTERN
from services.console.errors import BadArguments
from services.console.fleet.choice import Question

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Place = Annotated[str, StringConstraints(pattern=rf"^$|{PLACE_PATTERN}")]
Weight = Annotated[float, Field(ge=-10.0, le=10.0)]
Hours = Annotated[float, Field(ge=0.0, le=1e6)]
"""Since the Unix epoch: until the year 2084."""


class Asked(BaseModel):
    """What every question has."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    environment: Name

    @classmethod
    def of(cls, arguments: Mapping[str, Any]) -> Self:
        """The question of a browser.

        Raises:
            BadArguments: it is none.
        """
        try:
            return cls.model_validate(dict(arguments))
        except ValidationError as error:
            first = error.errors(include_url=False, include_context=False)[0]
            where = ".".join(map(str, first["loc"]))
            raise BadArguments(f"the page asks for something wrong: {where}: {first['msg']}") from None


class EnvironmentAsked(Asked):
    """What an environment is: places, routes, model, spectrum. ``sensor`` is empty for the maps of all."""

    sensor: Name | Annotated[str, StringConstraints(max_length=0)] = ""


class CostsAsked(EnvironmentAsked):
    """What its maps cost, and the plan; ``curves`` names those that the browser has already."""

    at_hours: Hours
    theta: tuple[Weight, Weight, Weight]
    per_metre: bool = False
    start: Place = ""
    goal: Place = ""
    curves: Annotated[str, StringConstraints(max_length=100)] = ""

    def question(self) -> Question:
        """The same, in the terms of costs and plans."""
        return Question(self.at_hours, Theta(*self.theta), self.per_metre, self.start, self.goal)


class SimilarityAsked(Asked):
    """How alike the maps of a route are; that with most maps where none is named."""

    start: Place = ""
    end: Place = ""
