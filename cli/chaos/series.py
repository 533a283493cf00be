"""Many faults, one after the other; those that had the fewest runs come first."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Iterator, Sequence

from cli.chaos.course import Course
from cli.chaos.faults import Doing, Fault, all_faults
from cli.chaos.judge import Outcome, unfinished
from cli.chaos.report import kind_of
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


def in_turn(cases: Sequence[Case], earlier: Sequence[Outcome], each: int | None = None) -> Iterator[Case]:
    """The cases, always the first of those that had the fewest runs, the earlier ones included.

    Without end, or until every kind of fault had ``each`` runs.
    """
    had = Counter((outcome.doing, outcome.fault) for outcome in earlier)
    kinds = Counter(kind_of(outcome.fault) for outcome in earlier)
    while todo := [case for case in cases if each is None or kinds[kind_of(case[1].name)] < each]:
        doing, fault = min(todo, key=lambda case: had[case[0], case[1].name])
        had[doing, fault.name] += 1
        kinds[kind_of(fault.name)] += 1
        yield doing, fault


def outcomes(course: Course, supervised: Supervised, cases: Iterator[Case], begins: OnCase) -> Iterator[Outcome]:
    """What comes of each case; ``begins`` is called before it."""
    for doing, fault in cases:
        begins((doing, fault))
        try:
            yield run(course, supervised, fault, doing)
        except CommandError as error:
            yield unfinished(fault, doing, str(error))
