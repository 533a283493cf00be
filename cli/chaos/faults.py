"""Every fault: what is done to which process, for how long, and what a robot must make of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from cli.chaos.orders import Kind
from cli.processes import ROBOT
from common import topics
from common.messages import StateName
from services.safety.limits import RuleSettings

Doing = Literal["teach", "repeat"]
How = Literal["kill", "stop", "hog"] | Kind


class Must(Enum):
    """What the robot must do: stop in time, drive on, or either of the two (but stay on its path)."""

    STOP = "stop"
    GO = "go"
    EITHER = "either"


@dataclass(frozen=True, slots=True)
class Fault:
    """One fault.

    Attributes:
        name: for the report.
        victim: the process that it happens to; empty for the machine.
        how: a signal (``kill``, ``stop``), ``hog`` for the machine, or an order to the process.
        seconds: how long it lasts; a killed process is started again by the supervisor.
        must: what the robot must do.
        silence_s: how long the robot may take to notice, that is the age limit of the input that fails; at the wheels,
            it may take as long again as it needs to brake.
        amount, key: of the order.
    """

    name: str
    victim: str
    how: How
    seconds: float
    must: Must
    silence_s: float = float("inf")
    amount: float = 0.0
    key: str = ""


LASTS_S = 2.0
_HANGS: tuple[How, ...] = ("kill", "stop", "hold")
_CRITICAL: dict[Doing, StateName] = {"teach": StateName.TEACH_BRANCH, "repeat": StateName.REPEAT_FOLLOW}
_LIMITS = RuleSettings()
_BASE_S = topics.SAFE.max_age_s
_SILENCE_S: dict[str, float] = {
    "sensors": _LIMITS.odometry_age,  # without frames there is no odometry
    "estimator": _LIMITS.odometry_age,
    "tracker": _LIMITS.command_age,
    "navigator": _LIMITS.state_age,
}
"""How old what a process says may become, by safety's rules; the base itself bounds the age of what safety says."""


def all_faults(doing: Doing) -> list[Fault]:
    """The faults of a teach or of a repeat, in a fixed order."""
    return [*_of_processes(doing), *_of_clocks(), *_of_messages(doing), *_of_sensors(), *_of_the_machine()]


def _of_processes(doing: Doing) -> Iterator[Fault]:
    """Killed, stopped, and hung in native code with the interpreter's lock."""
    for process in ROBOT:
        needed = _CRITICAL[doing] in process.critical
        for how in _HANGS:
            must = _must(process.name, how, doing) if needed else Must.GO
            silence = _silence(process.name) if must is Must.STOP else float("inf")
            if process.name == "router" and how == "hold":
                continue  # Zenoh's own threads route, and need no interpreter
            if process.name == "sensors" and how != "hold":
                continue  # the simulated world ends with it, and its wheels
            yield Fault(f"{how} {process.name}", process.name, how, LASTS_S, must, silence, amount=LASTS_S)


def _must(process: str, how: How, doing: Doing) -> Must:
    """What a robot must do that needs a process: it notices at once that it died, but not always that it hangs.

    While a human drives, that is the navigator and what lies between the two. The estimator's odometry is missed later,
    and then only for the map's sake; the vertices of a map wait for a store that hangs. The wheels of the simulated
    base hang with the sensors' process, and so does what is seen of them.
    """
    if how == "kill":
        return Must.STOP
    missed = process != "sensors" and (doing == "repeat" or process in {"navigator", "safety", "router"})
    return Must.STOP if missed else Must.EITHER


def _silence(process: str) -> float:
    """Seconds until the robot must know that a process it needs is gone."""
    return _SILENCE_S.get(process, _BASE_S)


def _of_clocks() -> Iterator[Fault]:
    for process in ROBOT:
        for hours in (1, -1):
            name = f"clock {hours:+d} h {process.name}"
            yield Fault(name, process.name, "clock", LASTS_S, Must.GO, amount=hours * 3600.0)


def _of_messages(doing: Doing) -> Iterator[Fault]:
    """Lost, late, doubled and in another order; what is lost altogether stops the robot where it is needed."""
    needed = [("navigator", topics.STATE)]
    if doing == "repeat":
        needed += [("estimator", topics.ODOMETRY), ("estimator", topics.LOCALIZATION), ("tracker", topics.DESIRED)]
    for process, topic in needed:
        yield Fault(f"drop {topic.key}", process, "drop", LASTS_S, Must.STOP, _silence(process), key=f"/{topic.key}")
        kinds: tuple[tuple[How, float], ...] = (("lose", 0.3), ("delay", 0.1), ("double", 0.0), ("reorder", 0.0))
        for kind, amount in kinds:
            yield Fault(f"{kind} {topic.key}", process, kind, LASTS_S, Must.EITHER, amount=amount, key=f"/{topic.key}")
    yield Fault("drop command/safe", "safety", "drop", LASTS_S, Must.STOP, _BASE_S, key=f"/{topics.SAFE.key}")
    yield Fault("lose frames", "sensors", "lose", LASTS_S, Must.EITHER, amount=0.3, key="/sensor/stereo")
    must = Must.STOP if doing == "repeat" else Must.EITHER
    yield Fault("drop frames", "sensors", "drop", LASTS_S, must, _silence("sensors"), key="/sensor/stereo")


def _of_sensors() -> Iterator[Fault]:
    kinds: tuple[tuple[How, float], ...] = (("freeze", 0.0), ("black", 0.0), ("extrinsics", 0.2))
    for kind, amount in kinds:
        yield Fault(f"{kind} camera", "sensors", kind, LASTS_S, Must.EITHER, amount=amount, key="/sensor/stereo")


def _of_the_machine() -> Iterator[Fault]:
    yield Fault("full disk", "mapstore", "full", LASTS_S, Must.EITHER)
    yield Fault("hog", "", "hog", LASTS_S, Must.EITHER)
