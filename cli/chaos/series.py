"""Many faults, one after the other; those that had the fewest runs come first."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from cli.chaos.course import Course
from cli.chaos.faults import Doing, Fault, all_faults
from cli.chaos.judge import Outcome, unfinished
from cli.chaos.run import run
from cli.errors import CommandError
from cli.supervision.supervised import Supervised

Case = tuple[Doing, Fault]
"""What the robot does, and what happens to it."""

OnCase = Callable[[Case], None]


def cases(only: str | None, seed: int) -> list[Case]:
    """Every fault whose name holds ``only``: by chance, but first those of a repeat, for a change takes long.

    Raises:
        CommandError: there is none.
    """
    found: list[Case] = []
    both: tuple[Doing, ...] = ("repeat", "teach")
    for doing in both:
        faults = [fault for fault in all_faults(doing) if only is None or only in fault.name]
        random.Random(seed).shuffle(faults)  # noqa: S311, chance for tests
        found += [(doing, fault) for fault in faults]
    if not found:
        raise CommandError(f"no fault's name holds '{only}'")
    return found


def in_turn(cases: Sequence[Case], earlier: Sequence[Outcome]) -> Iterator[Case]:
    """The cases without end, always the first of those that had the fewest runs, the earlier ones included."""
    had = Counter((outcome.doing, outcome.fault) for outcome in earlier)
    while True:
        doing, fault = min(cases, key=lambda case: had[case[0], case[1].name])
        had[doing, fault.name] += 1
        yield doing, fault


def outcomes(course: Course, supervised: Supervised, cases: Iterator[Case], begins: OnCase) -> Iterator[Outcome]:
    """What comes of each case; ``begins`` is called before it."""
    for doing, fault in cases:
        begins((doing, fault))
        try:
            yield run(course, supervised, fault, doing)
        except CommandError as error:
            yield unfinished(fault, doing, str(error))
