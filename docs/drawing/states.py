"""The state diagram as a picture that needs no program in the browser: SVG from the same text that GitHub draws."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

_EDGE = re.compile(r"^\s*(?P<source>\w+) --> (?P<target>\w+): (?P<label>.*)$", re.MULTILINE)
_NAME = re.compile(r'state "(?P<name>\w+)" as (?P<id>\w+)')
_WIDTH, _HEIGHT = 1180, 800
_LINE, _LETTER = 14.0, 5.9
"""Height of a line and width of a letter, pixels."""
_PARTS = (0.5, 0.42, 0.58, 0.35, 0.65, 0.28, 0.72, 0.2, 0.8)


@dataclass(frozen=True, slots=True)
class Box:
    """A state, or the group of a meta-state: its middle and its size, pixels."""

    x: float
    y: float
    width: float = 126.0
    height: float = 44.0
    group: bool = False

    def border(self, towards: tuple[float, float]) -> tuple[float, float]:
        """The point of the border in the direction of another point."""
        dx, dy = towards[0] - self.x, towards[1] - self.y
        scale = min(
            self.width / 2 / abs(dx) if dx else math.inf,
            self.height / 2 / abs(dy) if dy else math.inf,
        )
        return self.x + dx * scale, self.y + dy * scale


BOXES: dict[str, Box] = {
    "Teach": Box(590, 130, 860, 180, group=True),
    "Repeat": Box(590, 660, 860, 180, group=True),
    "Idle": Box(80, 400),
    "Paused": Box(1100, 400),
    "Teach_MetricLocalize": Box(260, 140),
    "Teach_Branch": Box(590, 140),
    "Teach_Merge": Box(920, 140),
    "Repeat_Plan": Box(260, 650),
    "Repeat_MetricLocalize": Box(590, 650),
    "Repeat_Follow": Box(920, 650),
}
"""Where each state stands; a state without a place is an error, so that none is left out."""


def picture(diagram: str) -> str:
    """The SVG of a diagram in Mermaid's notation.

    Raises:
        KeyError: it has a state that has no place in :data:`BOXES`.
    """
    names = {found["id"]: found["name"] for found in _NAME.finditer(diagram)}
    edges = [(found["source"], found["target"], found["label"]) for found in _EDGE.finditer(diagram)]
    labels = Labels()
    drawn = "".join([*_boxes(names), *(_edge(*edge, _turn(edge, edges), labels) for edge in edges), *labels.texts])
    head = '<marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
    marker = f'<defs>{head}<path class="head" d="M0,0 L8,4 L0,8 z"/></marker></defs>'
    about = "The states, and the events that lead from one to another"
    return (
        f'<svg class="states" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{about}">{marker}{drawn}</svg>\n'
    )


class Labels:
    """The texts beside the edges: each takes the first of its places that no state and no other text has taken."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self._taken = [
            (box.x - box.width / 2, box.y - box.height / 2, box.x + box.width / 2, box.y + box.height / 2)
            for box in BOXES.values()
            if not box.group
        ]

    def put(self, places: Sequence[tuple[float, float]], label: str) -> None:
        """Writes a label, its events below one another, with its middle at one of the places."""
        lines = label.split(", ")
        half = max(map(len, lines)) * _LETTER / 2, len(lines) * _LINE / 2
        free = (place for place in places if not self._overlaps(place, half))
        x, y = next(free, places[0])
        self._taken.append((x - half[0], y - half[1], x + half[0], y + half[1]))
        top = y - _LINE * (len(lines) - 1) / 2 + 4
        rows = (
            f'<tspan x="{x:.1f}" y="{top + _LINE * row:.1f}">{escape(line)}</tspan>' for row, line in enumerate(lines)
        )
        self.texts.append(f'<text class="label" text-anchor="middle">{"".join(rows)}</text>')

    def _overlaps(self, place: tuple[float, float], half: tuple[float, float]) -> bool:
        (x, y), (width, height) = place, half
        return any(
            x - width < right and x + width > left and y - height < bottom and y + height > top
            for left, top, right, bottom in self._taken
        )


def _boxes(names: dict[str, str]) -> Iterator[str]:
    for key, box in sorted(BOXES.items(), key=lambda item: not item[1].group):
        kind = "group" if box.group else "state"
        x, y = box.x - box.width / 2, box.y - box.height / 2
        yield f'<rect class="{kind}" x="{x}" y="{y}" width="{box.width}" height="{box.height}" rx="9"/>'
        height = y + 18 if box.group else box.y + 4.5
        yield f'<text class="name" x="{box.x}" y="{height}">{escape(names.get(key, key))}</text>'


def _turn(edge: tuple[str, str, str], edges: Sequence[tuple[str, str, str]]) -> float:
    """How far an edge bends to its left: away from one that leads back."""
    source, target, _ = edge
    back = any(one[:2] == (target, source) for one in edges)
    return 0.16 if back else 0.06


def _edge(source: str, target: str, label: str, turn: float, labels: Labels) -> str:
    a, b = BOXES[source], BOXES[target]
    if source == target:
        return _loop(a, label, labels)
    if a.group and target.startswith(f"{source}_"):
        a = Box(a.x - a.width / 2, b.y, 0.0, 0.0)  # from wherever in the group: a short arrow from its edge
        b = Box(b.x - b.width / 2, b.y, 0.0, 0.0)
        labels.put([((a.x + b.x) / 2, a.y - 10)], label)
        return _arrow(f"M{a.x},{a.y} L{b.x},{b.y}")
    bend = ((a.x + b.x) / 2 - (b.y - a.y) * turn, (a.y + b.y) / 2 + (b.x - a.x) * turn)
    start, end = a.border(bend), b.border(bend)
    labels.put([_along(start, bend, end, part) for part in _PARTS], label)
    return _arrow(f"M{_point(start)} Q{_point(bend)} {_point(end)}")


def _loop(box: Box, label: str, labels: Labels) -> str:
    """An edge from a state to itself, at its top, or at the lower corner of a group."""
    x, y = (box.x + box.width / 2 - 60, box.y + box.height / 2) if box.group else (box.x, box.y - box.height / 2)
    reach = 34.0 if box.group else -34.0
    lines = label.count(", ") + 1
    labels.put([(x, y + reach + (10 if box.group else 2 - _LINE * lines / 2))], label)
    return _arrow(f"M{x - 16},{y} C{x - 26},{y + reach} {x + 26},{y + reach} {x + 16},{y}")


def _arrow(path: str) -> str:
    return f'<path class="edge" marker-end="url(#head)" d="{path}"/>'


def _along(
    start: tuple[float, float], bend: tuple[float, float], end: tuple[float, float], part: float
) -> tuple[float, float]:
    """A point of a quadratic curve."""
    a, b, c = (1 - part) ** 2, 2 * part * (1 - part), part**2
    return a * start[0] + b * bend[0] + c * end[0], a * start[1] + b * bend[1] + c * end[1]


def _point(at: tuple[float, float]) -> str:
    return f"{at[0]:.1f},{at[1]:.1f}"
