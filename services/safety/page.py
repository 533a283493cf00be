"""The rules as a truth table for the documentation, drawn from the rules themselves."""

from __future__ import annotations

from dataclasses import asdict

from services.safety.inputs import MOTION_OF_STATE, CommandKind
from services.safety.limits import RuleSettings
from services.safety.rules import RULES, Effect

_COLUMNS: tuple[tuple[str, CommandKind | None], ...] = (
    ("standing", None),
    ("teaching", CommandKind.TELEOP),
    ("repeating", CommandKind.DESIRED),
)
_DOES = {
    Effect.SLOW: "slows down",
    Effect.STOP: "ramps to zero",
    Effect.EMERGENCY: "stops at once",
}


def truth_table(settings: RuleSettings | None = None) -> str:
    """A row for each rule, in Markdown: what trips it, and what it does by what the state lets the robot do."""
    limits = asdict(settings or RuleSettings())
    head = ["rule", "objects when", *(name for name, _ in _COLUMNS)]
    rows = [
        [
            f"`{rule.cause}`",
            rule.when.format_map(limits),
            *(_DOES[rule.effect] if motion in rule.asked_for else "" for _, motion in _COLUMNS),
        ]
        for rule in RULES
    ]
    return "".join(f"| {' | '.join(row)} |\n" for row in [head, ["---"] * len(head), *rows])


def motion_table() -> str:
    """The states in which the robot may move at all, and whose commands move it then."""
    whose = {
        CommandKind.TELEOP: "the operator's, `command/teleop`",
        CommandKind.DESIRED: "the tracker's, `command/desired`",
    }
    head = [["state", "commands that may pass"], ["---"] * 2]
    rows = [*head, *([f"`{state}`", whose[kind]] for state, kind in MOTION_OF_STATE.items())]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)
