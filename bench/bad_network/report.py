"""The run as a page: the verdict, its figures, and what each robot and the server took."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass

from bench.bad_network.judge import RESTS_WITHIN_S, SYNC_S, Verdict
from bench.bad_network.plan import PARTITION_S, Plan
from bench.bad_network.site import FLEET, HELD_S

Figures = dict[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Cost:
    """Share of a core and megabytes of one process, the mean and the most of all robots."""

    cpu: float
    cpu_most: float
    memory: float
    memory_most: float


def costs(before: Figures, after: Figures, seconds: float) -> dict[tuple[str, str], Cost]:
    """By machine (``robot`` or ``fleet``) and service; ``all`` sums a machine's services."""
    rows: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    sums: dict[str, list[float]] = defaultdict(lambda: [0.0, 0.0])
    for name in before.keys() & after.keys():
        machine, dot, service = name.partition(".")
        if not dot:
            continue
        cpu, memory = (after[name][0] - before[name][0]) / seconds, after[name][1]
        rows["fleet" if machine == FLEET else "robot", service].append((cpu, memory))
        sums[machine][0] += cpu
        sums[machine][1] += memory
    for machine, (cpu, memory) in sums.items():
        rows["fleet" if machine == FLEET else "robot", "all"].append((cpu, memory))
    return {key: _cost(values) for key, values in sorted(rows.items())}


def _cost(values: list[tuple[float, float]]) -> Cost:
    cpus, memories = zip(*values, strict=True)
    return Cost(sum(cpus) / len(cpus), max(cpus), sum(memories) / len(memories), max(memories))


_TEXT = """\
# Many robots under a bad network

`python -m bench.bad_network` (as root): {robots} robots, {minutes:.3g} minutes; {delay:.0f} ms of delay and
{loss:.0f} % of loss each way; half of the robots cut off for {partition:.0f} s once a minute, and all of them at the
end, which makes {partitions} partitions.

Each robot has a network namespace of its own with router, map store, safety and navigator, the server one with
router, embedded S3 and server: their real processes. Base, estimator and camera are synthetic: they commit a vertex of
10 kB every 0.4 m, and end a map every 25. The operator, at the server's side, holds each robot's dead man's switch
(silent for {held:g} s, the robot stops), and presses its emergency stop every 50 s or so.

A kernel without `netem` was at hand, so IP packets are delayed, lost and cut by a program between TUN devices
(`bench/bad_network/wire.py`); what TCP, Zenoh and S3 make of that is theirs.

**{summary}**
{wrong}
| what | measured |
|---|---|
{rows}

Processor (share of a core) and resident memory, mean and most of the robots:

| machine | process | CPU | most | MB | most |
|---|---|---|---|---|---|
{costs}
"""


def page(plan: Plan, verdict: Verdict, spent: dict[tuple[str, str], Cost], carried: dict[str, dict[str, int]]) -> str:
    """The page, in Markdown."""
    rows = _rows(verdict.figures, carried)
    return _TEXT.format(
        robots=len(plan.robots),
        minutes=plan.seconds / 60,
        delay=1e3 * plan.delay_s,
        loss=100 * plan.loss,
        partition=PARTITION_S,
        partitions=len(plan.partitions),
        held=HELD_S,
        summary="All is well." if not verdict.wrong else "Not all is well:",
        wrong="".join(f"\n* {sentence}" for sentence in verdict.wrong) + ("\n" if verdict.wrong else ""),
        rows="\n".join(f"| {what} | {value} |" for what, value in rows.items()),
        costs="\n".join(
            f"| {machine} | {service} | {c.cpu:.3f} | {c.cpu_most:.3f} | {c.memory:.0f} | {c.memory_most:.0f} |"
            for (machine, service), c in spent.items()
        ),
    )


def _rows(f: dict[str, float], carried: dict[str, dict[str, int]]) -> dict[str, str]:
    packets = {what: sum(counts[what] for counts in carried.values()) for what in ("packets", "lost", "cut", "bytes")}
    return {
        "maps taught, and found whole in the fleet's storage": f"{f['maps']:.0f}",
        "vertices committed, and found once in the robot's store and once in the fleet's": f"{f['commits']:.0f}",
        "commits that had to be repeated": f"{f['commits_repeated']:.0f}",
        "metres driven": f"{f['metres']:.0f}",
        "emergency stops, of them while cut off": f"{f['stops']:.0f}, {f['stops_while_cut_off']:.0f}",
        f"from the button to rest, median and most (bound {RESTS_WITHIN_S:g} s)": _two(f, "rest_s"),
        "from the button to the answer, linked": _two(f, "answered_linked_s"),
        "from the button to the answer, cut off": _two(f, "answered_cut_s"),
        f"all in sync after the last partition (bound {SYNC_S:g} s)": f"{f['in_sync_s']:.1f} s",
        "packets carried, lost, cut": f"{packets['packets']}, {packets['lost']}, {packets['cut']}",
        "carried": f"{packets['bytes'] / 1e6:.0f} MB",
    }


def _two(figures: dict[str, float], name: str) -> str:
    if f"{name}_median" not in figures:
        return "none"
    return f"{figures[f'{name}_median']:.2f} s, {figures[f'{name}_most']:.2f} s"
