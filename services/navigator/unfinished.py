"""What a mission was about, kept in a small file: a navigator that is started anew comes back paused, and knows it."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from pydantic import BaseModel, ConfigDict, ValidationError

from common.errors import RetraverseError
from common.ids import VertexId
from common.messages import Goal, MapRecord, Name, PlaceName, StateName
from services.navigator.mission import Mission

_TEACHING = {StateName.TEACH_METRIC_LOCALIZE, StateName.TEACH_BRANCH, StateName.TEACH_MERGE}


class UnfinishedUnreadable(RetraverseError):
    """The file exists and holds no mission."""


class Unfinished(BaseModel):
    """A mission that is not over: a map that is being taught, or a goal that is not reached."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    environment: Name
    resumes: StateName
    target: VertexId | None = None
    map: MapRecord | None = None
    start_place: PlaceName | None = None
    candidates: tuple[VertexId, ...] = ()
    goal: Goal | None = None
    goals: tuple[Goal, ...] = ()

    @classmethod
    def of(cls, mission: Mission) -> Self | None:
        """What of a mission outlives the navigator; None of one that is over.

        A route does not: a repeat is planned anew, from where the robot was last localized.
        """
        state = mission.resumes or mission.name
        if state in {StateName.IDLE, StateName.PAUSED}:
            return None
        teaches = state in _TEACHING
        return cls(
            environment=mission.environment,
            resumes=state if teaches else StateName.REPEAT_PLAN,
            target=mission.target if teaches else None,
            map=mission.map if teaches else None,
            start_place=mission.start_place if teaches else None,
            candidates=mission.candidates,
            goal=mission.goal,
            goals=mission.goals,
        )

    def mission(self, now: float, position: VertexId | None) -> Mission:
        """The mission, paused; ``position`` is where the robot was localized last."""
        return Mission(
            name=StateName.PAUSED,
            since=now,
            reason="the navigator was started anew",
            environment=self.environment,
            position=position,
            resumes=self.resumes,
            target=self.target,
            map=self.map,
            start_place=self.start_place,
            candidates=self.candidates,
            goal=self.goal,
            goals=self.goals,
        )


def load(path: Path) -> Unfinished | None:
    """The mission in a file, None where there is no file.

    Raises:
        UnfinishedUnreadable: the file cannot be read, or holds something else.
    """
    try:
        return Unfinished.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValidationError) as error:
        reason = str(error).splitlines()[0]
        raise UnfinishedUnreadable(f"the last mission cannot be read from {path}, so it is over: {reason}") from None


def save(path: Path, unfinished: Unfinished | None) -> None:
    """Replaces the file in one step; without a mission, removes it.

    Raises:
        OSError: the folder or the file cannot be written.
    """
    if unfinished is None:
        path.unlink(missing_ok=True)
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".new")
    draft.write_text(unfinished.model_dump_json(), encoding="utf-8")
    draft.replace(path)
