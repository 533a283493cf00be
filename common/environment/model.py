"""An environment as a file holds it: its name, the model of its rhythms, and its maps."""

from __future__ import annotations

import difflib
import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from common.errors import ConfigurationError

_LARGEST = 1 << 31
_HOURS = 24


def _moment(value: object) -> datetime:
    if isinstance(value, datetime):
        return value
    if not isinstance(value, str):
        raise ValueError("write a time as ISO 8601, as 2023-05-07T17:08:32+02:00")  # noqa: TRY004, pydantic takes this one
    return parse_time(value)


def parse_time(text: str) -> datetime:
    """A time written as ISO 8601; one without an offset is UTC.

    Raises:
        ValueError: the text is no such time.
    """
    try:
        moment = datetime.fromisoformat(text.strip())
    except ValueError:
        raise ValueError(f"'{text}' is no time: write ISO 8601, as 2023-05-07T17:08:32+02:00") from None
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment


def _name(text: str) -> str:
    if not text.strip():
        raise ValueError("a name is empty")
    return text


Name = Annotated[str, AfterValidator(_name)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class Model(BaseModel):
    """What repeats in an environment, and how fast it changes for good: the parameters of (3.1) and (3.2).

    Attributes:
        periods_hours: T_i, hours.
        weights: w_i.
        phases: phi_i, radians.
        trend_per_hour: a, 1/hour.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    periods_hours: tuple[Positive, ...] = ()
    weights: tuple[Finite, ...] = ()
    phases: tuple[Finite, ...] = ()
    trend_per_hour: NotNegative = 0.0

    @model_validator(mode="after")
    def _same_number(self) -> Self:
        counts = len(self.periods_hours), len(self.weights), len(self.phases)
        if len(set(counts)) > 1:
            raise ValueError(f"there are {counts[0]} periods, {counts[1]} weights and {counts[2]} phases: each has one")
        return self


class MapEntry(BaseModel):
    """One map: a directed edge between two places.

    Attributes:
        name: unique in the environment.
        start, end: the places that it leads from and to.
        timestamp: when it was recorded.
        length: metres.
        generation: 0 for a taught map, n + 1 for one recorded while repeating generation n.
        trouble: by hour of the day (UTC), the share of the metres driven on it that were not localized
            (:mod:`common.environment.trouble`); empty where nobody has repeated it.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    start: Name
    end: Name
    timestamp: Annotated[datetime, BeforeValidator(_moment)]
    length: NotNegative
    generation: Annotated[int, Field(ge=0, le=_LARGEST)] = 0
    trouble: tuple[Share, ...] = ()

    @field_validator("trouble")
    @classmethod
    def _by_the_hour(cls, shares: tuple[float, ...]) -> tuple[float, ...]:
        if len(shares) not in {0, _HOURS}:
            raise ValueError(
                f"the trouble of a map has {_HOURS} shares, one for each hour of the day, not {len(shares)}"
            )
        return shares


class Environment(BaseModel):
    """A named set of places and maps, with its model."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    name: Name
    model: Model = Model()
    maps: tuple[MapEntry, ...] = ()

    @model_validator(mode="after")
    def _unique(self) -> Self:
        seen: set[str] = set()
        for entry in self.maps:
            if entry.name in seen:
                raise ValueError(f"two maps are named '{entry.name}': a plan could not tell them apart")
            seen.add(entry.name)
        return self


def read_environment(path: Path) -> Environment:
    """The environment in a JSON file.

    Raises:
        ConfigurationError: there is no such file, or it holds no environment; the sentence says where it is wrong.
    """
    content = read_json(path)
    try:
        return Environment.model_validate(content)
    except ValidationError as error:
        raise ConfigurationError(_sentence(path, error)) from None


def environment_json(environment: Environment) -> dict[str, Any]:
    """The content of the file that :func:`read_environment` reads; a map's trouble only where there is any."""
    content = environment.model_dump(mode="json")
    for entry in content["maps"]:
        if not entry["trouble"]:
            del entry["trouble"]
    return content


def read_json(path: Path) -> Any:  # noqa: ANN401, whatever JSON can hold
    """What a JSON file holds.

    Raises:
        ConfigurationError: there is no such file, or it is no JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise ConfigurationError(f"cannot read {path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(f"{path} is not JSON: {error}") from None


def _sentence(path: Path, error: ValidationError) -> str:
    """One sentence on the first thing that is wrong."""
    first = error.errors(include_url=False)[0]
    location = tuple(first["loc"])
    where = _where(location)
    if first["type"] == "extra_forbidden":
        near = difflib.get_close_matches(str(location[-1]), _keys(location), 1)
        hint = f"; did you mean '{near[0]}'?" if near else f"; the keys there are {', '.join(_keys(location))}"
        return f"{path}: '{where}' is not known{hint}"
    if first["type"] == "missing":
        return f"{path}: '{where}' is missing"
    if first["type"] == "model_type":
        return f"{path}: {where or 'the file'} must be a JSON object"
    text = first["msg"].removeprefix("Value error, ")
    got = "" if first["type"] == "value_error" else f", got {first['input']!r:.80}"
    return f"{path}: {where + ': ' if where else ''}{text}{got}"


def _where(location: Sequence[str | int]) -> str:
    """A place of the file, as ``maps[3].length``."""
    text = ""
    for step in location:
        text += f"[{step}]" if isinstance(step, int) else f"{'.' if text else ''}{step}"
    return text


def _keys(location: Sequence[str | int]) -> list[str]:
    """The keys of the object in which something at ``location`` stands."""
    kinds: dict[str | int, type[BaseModel]] = {"model": Model, "maps": MapEntry}
    return list((kinds.get(location[0], Environment) if len(location) > 1 else Environment).model_fields)
