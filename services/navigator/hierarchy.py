"""The table of states and transitions (VT&R3's overview), the machine that runs it, and the diagram drawn from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from transitions.extensions import HierarchicalMachine
from transitions.extensions.nesting import NestedState

from common.messages import StateName
from services.navigator.mission import Mission

_ANY_TEACH, _ANY_REPEAT = "Teach", "Repeat"
"""The meta-states: a transition from one of them leaves each of its states."""


@dataclass(frozen=True, slots=True)
class Transition:
    """A row of the table: on ``event``, from ``source`` (a state or a meta-state) to ``dest``, if ``guard`` holds.

    ``guard`` names a method of :class:`Guards`; of several rows with one event and source the first that holds is
    taken. Without a ``dest`` the state stays, and only what it keeps changes.
    """

    event: str
    source: str
    dest: str | None
    guard: str = ""


_S = StateName
TABLE: tuple[Transition, ...] = (
    Transition("teach", _S.IDLE, _S.TEACH_METRIC_LOCALIZE, "starts_at_a_vertex"),
    Transition("teach", _S.IDLE, _S.TEACH_BRANCH),
    Transition("localized", _S.TEACH_METRIC_LOCALIZE, _S.TEACH_BRANCH),
    Transition("finish", _S.TEACH_BRANCH, _S.IDLE),
    Transition("finish", _S.TEACH_MERGE, _S.IDLE),
    Transition("finish", _S.PAUSED, _S.IDLE, "was_mapping"),
    Transition("merge", _S.TEACH_BRANCH, _S.TEACH_MERGE),
    Transition("merge", _S.TEACH_MERGE, None),
    Transition("offered", _S.TEACH_MERGE, None, "has_no_offer"),
    Transition("confirm", _S.TEACH_MERGE, _S.IDLE, "has_an_offer"),
    Transition("reject", _S.TEACH_MERGE, _S.TEACH_BRANCH, "rejects_the_last_candidate"),
    Transition("reject", _S.TEACH_MERGE, None, "has_an_offer"),
    Transition("branch", _S.TEACH_MERGE, _S.TEACH_BRANCH),
    Transition("repeat", _S.IDLE, _S.PAUSED, "rests"),
    Transition("repeat", _S.IDLE, _S.REPEAT_PLAN),
    Transition("swap", _ANY_REPEAT, _S.REPEAT_PLAN),
    Transition("swap", _S.PAUSED, _S.REPEAT_PLAN, "was_repeating"),
    Transition("append", _ANY_REPEAT, None),
    Transition("append", _S.PAUSED, None, "was_repeating"),
    Transition("planned", _S.REPEAT_PLAN, _S.REPEAT_METRIC_LOCALIZE),
    Transition("planned", _S.PAUSED, None, "was_planning"),
    Transition("not_planned", _S.REPEAT_PLAN, _S.IDLE),
    Transition("not_planned", _S.PAUSED, _S.IDLE, "was_planning"),
    Transition("localized", _S.REPEAT_METRIC_LOCALIZE, _S.REPEAT_FOLLOW),
    Transition("extended", _S.REPEAT_FOLLOW, None),
    Transition("goes_on", _S.REPEAT_FOLLOW, _S.REPEAT_METRIC_LOCALIZE),
    Transition("arrived", _S.REPEAT_FOLLOW, _S.PAUSED, "rests"),
    Transition("arrived", _S.REPEAT_FOLLOW, _S.REPEAT_PLAN, "has_another_goal"),
    Transition("arrived", _S.REPEAT_FOLLOW, _S.IDLE),
    Transition("timed_out", _S.TEACH_METRIC_LOCALIZE, _S.IDLE),
    Transition("timed_out", _S.TEACH_MERGE, _S.TEACH_BRANCH),
    Transition("timed_out", _S.REPEAT_PLAN, _S.IDLE),
    Transition("timed_out", _S.REPEAT_METRIC_LOCALIZE, _S.IDLE),
    Transition("timed_out", _S.PAUSED, _S.IDLE),
    Transition("pause", _ANY_TEACH, _S.PAUSED),
    Transition("pause", _ANY_REPEAT, _S.PAUSED),
    Transition("lost", _ANY_TEACH, _S.PAUSED),
    Transition("lost", _ANY_REPEAT, _S.PAUSED),
    Transition("pause_ahead", _S.REPEAT_FOLLOW, None),
    Transition("pause", _S.PAUSED, None, "goes_on_by_itself"),
    Transition("resume", _S.PAUSED, _S.TEACH_METRIC_LOCALIZE, "was_localizing_to_teach"),
    Transition("resume", _S.PAUSED, _S.TEACH_BRANCH, "was_branching"),
    Transition("resume", _S.PAUSED, _S.TEACH_MERGE, "was_merging"),
    Transition("resume", _S.PAUSED, _S.REPEAT_PLAN, "was_planning"),
    Transition("resume", _S.PAUSED, _S.REPEAT_METRIC_LOCALIZE, "has_a_route"),
    Transition("cancel", _ANY_TEACH, _S.IDLE),
    Transition("cancel", _ANY_REPEAT, _S.IDLE),
    Transition("cancel", _S.PAUSED, _S.IDLE),
)


class Guards:
    """What the guards of the table look at, and the state itself: the model that ``transitions`` moves.

    Attributes:
        before: the mission as it is; its ``resumes`` is the state behind a pause.
        wanted: the mission as the event would have it.
    """

    def __init__(self, mission: Mission) -> None:
        self.state: str = mission.name
        self.before = self.wanted = mission

    def goes_on_by_itself(self) -> bool:
        """Whether the pause ends when what was lost is back, or at its time."""
        return self.before.recovery > 0.0 or self.before.rests > 0.0

    def starts_at_a_vertex(self) -> bool:
        """Whether a new map branches off a vertex that the robot can be localized against."""
        return self.wanted.target is not None

    def rests(self) -> bool:
        """Whether the robot rests before it sets out for the next goal."""
        return self.wanted.rests > 0.0

    def has_another_goal(self) -> bool:
        """Whether a goal waits behind the one that is reached."""
        return bool(self.before.goals)

    def has_no_offer(self) -> bool:
        """Whether no loop closure waits for the operator's word."""
        return self.before.closure is None

    def has_an_offer(self) -> bool:
        """Whether one does."""
        return self.before.closure is not None

    def rejects_the_last_candidate(self) -> bool:
        """Whether no candidate is left once the one that is offered is rejected."""
        return self.before.closure is not None and not self.wanted.candidates

    def was_localizing_to_teach(self) -> bool:
        """Whether the pause holds a teach that has not begun to branch."""
        return self.before.resumes is StateName.TEACH_METRIC_LOCALIZE

    def was_branching(self) -> bool:
        """Whether the pause holds a map that is being taught."""
        return self.before.resumes is StateName.TEACH_BRANCH

    def was_merging(self) -> bool:
        """Whether the pause holds a map for which a loop closure is looked for."""
        return self.before.resumes is StateName.TEACH_MERGE

    def was_mapping(self) -> bool:
        """Whether the pause holds a map, merging or not."""
        return self.was_branching() or self.was_merging()

    def was_planning(self) -> bool:
        """Whether the pause holds a repeat that has no route yet."""
        return self.before.resumes is StateName.REPEAT_PLAN

    def has_a_route(self) -> bool:
        """Whether the pause holds a repeat with a route; the robot may have been moved, so it is localized anew."""
        return self.before.resumes in (StateName.REPEAT_METRIC_LOCALIZE, StateName.REPEAT_FOLLOW)

    def was_repeating(self) -> bool:
        """Whether the pause holds a repeat."""
        return self.was_planning() or self.has_a_route()


class _State(NestedState):
    separator = "."


class _Machine(HierarchicalMachine):
    state_cls = _State


class Hierarchy:
    """The hierarchical machine in one of its states. An event that the state does not know changes nothing."""

    def __init__(self, mission: Mission) -> None:
        """Starts in the state of a mission."""
        self._guards = Guards(mission)
        rows = [
            {"trigger": row.event, "source": _name(row.source), "dest": row.dest and _name(row.dest)}
            | ({"conditions": row.guard} if row.guard else {})
            for row in TABLE
        ]
        self._machine = _Machine(
            self._guards,
            states=[
                {"name": parent, "children": children} if children else parent
                for parent, children in _families().items()
            ],
            transitions=rows,
            initial=mission.name.value,
            auto_transitions=False,
            ignore_invalid_triggers=True,
        )

    @property
    def state(self) -> StateName:
        """The state that it is in."""
        return StateName(self._guards.state)

    def fire(self, event: str, before: Mission, wanted: Mission) -> bool:
        """Runs an event; returns whether the table has a transition for it whose guard holds.

        ``wanted`` is the mission with what the event changes.
        """
        self._guards.before, self._guards.wanted = before, wanted
        return bool(self._guards.trigger(event))  # type: ignore[attr-defined]

    def may(self, event: str, mission: Mission) -> bool:
        """Whether :meth:`fire` would, of an event that changes nothing that a guard looks at."""
        self._guards.before = self._guards.wanted = mission
        return bool(self._guards.may_trigger(event))  # type: ignore[attr-defined]


def diagram() -> str:
    """The machine as the text of a Mermaid state diagram, for the documentation."""
    return "\n".join(["stateDiagram-v2", "    direction LR", "    [*] --> Idle", *_boxes(), *_arrows()]) + "\n"


def _boxes() -> Iterator[str]:
    for parent, children in _families().items():
        if children:
            yield f"    state {parent} {{"
            yield from (f'        state "{child}" as {parent}_{child}' for child in children)
            yield "    }"
        else:
            yield f"    {parent}"


def _arrows() -> Iterator[str]:
    """One arrow between two states, labelled with all of its events."""
    labels: dict[tuple[str, str], list[str]] = {}
    for row in TABLE:
        label = row.event + (f" [{row.guard.replace('_', ' ')}]" if row.guard else "")
        ends = (_name(row.source), _name(row.dest or row.source))
        labels.setdefault(ends, []).append(label)
    for (source, dest), events in labels.items():
        yield f"    {source.replace('.', '_')} --> {dest.replace('.', '_')}: {', '.join(events)}"


def _name(state: str) -> str:
    return state.value if isinstance(state, StateName) else state


def _families() -> dict[str, list[str]]:
    """The states by their meta-state: ``Teach.Branch`` is the child ``Branch`` of ``Teach``."""
    families: dict[str, list[str]] = {}
    for name in StateName:
        parent, _, child = name.value.partition(".")
        families.setdefault(parent, []).extend([child] if child else [])
    return families
