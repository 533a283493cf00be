"""The table of states and transitions (VT&R3's overview), the machine that runs it, and the diagram drawn from it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from transitions.extensions import HierarchicalMachine
from transitions.extensions.nesting import NestedState

from common.messages import StateName

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
    Transition("finish", _S.PAUSED, _S.IDLE, "was_branching"),
    Transition("repeat", _S.IDLE, _S.REPEAT_PLAN),
    Transition("planned", _S.REPEAT_PLAN, _S.REPEAT_METRIC_LOCALIZE),
    Transition("planned", _S.PAUSED, None, "was_planning"),
    Transition("not_planned", _S.REPEAT_PLAN, _S.IDLE),
    Transition("not_planned", _S.PAUSED, _S.IDLE, "was_planning"),
    Transition("localized", _S.REPEAT_METRIC_LOCALIZE, _S.REPEAT_FOLLOW),
    Transition("arrived", _S.REPEAT_FOLLOW, _S.IDLE),
    Transition("timed_out", _S.TEACH_METRIC_LOCALIZE, _S.IDLE),
    Transition("timed_out", _S.REPEAT_PLAN, _S.IDLE),
    Transition("timed_out", _S.REPEAT_METRIC_LOCALIZE, _S.IDLE),
    Transition("timed_out", _S.PAUSED, _S.IDLE),
    Transition("pause", _ANY_TEACH, _S.PAUSED),
    Transition("pause", _ANY_REPEAT, _S.PAUSED),
    Transition("lost", _ANY_TEACH, _S.PAUSED),
    Transition("lost", _ANY_REPEAT, _S.PAUSED),
    Transition("resume", _S.PAUSED, _S.TEACH_METRIC_LOCALIZE, "was_localizing_to_teach"),
    Transition("resume", _S.PAUSED, _S.TEACH_BRANCH, "was_branching"),
    Transition("resume", _S.PAUSED, _S.REPEAT_PLAN, "was_planning"),
    Transition("resume", _S.PAUSED, _S.REPEAT_METRIC_LOCALIZE, "has_a_route"),
    Transition("cancel", _ANY_TEACH, _S.IDLE),
    Transition("cancel", _ANY_REPEAT, _S.IDLE),
    Transition("cancel", _S.PAUSED, _S.IDLE),
)


class Guards:
    """What the guards of the table look at, and the state itself: the model that ``transitions`` moves."""

    def __init__(self) -> None:
        self.state: str = StateName.IDLE
        self.target_known = False
        self.resumes: StateName | None = None

    def starts_at_a_vertex(self) -> bool:
        """Whether a new map branches off a vertex that the robot can be localized against."""
        return self.target_known

    def was_localizing_to_teach(self) -> bool:
        """Whether the pause holds a teach that has not begun to branch."""
        return self.resumes is StateName.TEACH_METRIC_LOCALIZE

    def was_branching(self) -> bool:
        """Whether the pause holds a map that is being taught."""
        return self.resumes is StateName.TEACH_BRANCH

    def was_planning(self) -> bool:
        """Whether the pause holds a repeat that has no route yet."""
        return self.resumes is StateName.REPEAT_PLAN

    def has_a_route(self) -> bool:
        """Whether the pause holds a repeat with a route; the robot may have been moved, so it is localized anew."""
        return self.resumes in (StateName.REPEAT_METRIC_LOCALIZE, StateName.REPEAT_FOLLOW)


class _State(NestedState):
    separator = "."


class _Machine(HierarchicalMachine):
    state_cls = _State


class Hierarchy:
    """The hierarchical machine in one of its states. An event that the state does not know changes nothing."""

    def __init__(self) -> None:
        self._guards = Guards()
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
            initial=StateName.IDLE.value,
            auto_transitions=False,
            ignore_invalid_triggers=True,
        )

    @property
    def state(self) -> StateName:
        """The state that it is in."""
        return StateName(self._guards.state)

    def fire(self, event: str, *, target_known: bool, resumes: StateName | None) -> bool:
        """Runs an event; returns whether the table has a transition for it whose guard holds."""
        self._look_at(target_known=target_known, resumes=resumes)
        return bool(self._guards.trigger(event))  # type: ignore[attr-defined]

    def may(self, event: str, *, target_known: bool, resumes: StateName | None) -> bool:
        """Whether :meth:`fire` would."""
        self._look_at(target_known=target_known, resumes=resumes)
        return bool(self._guards.may_trigger(event))  # type: ignore[attr-defined]

    def _look_at(self, *, target_known: bool, resumes: StateName | None) -> None:
        self._guards.target_known, self._guards.resumes = target_known, resumes


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
