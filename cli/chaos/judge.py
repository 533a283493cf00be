"""What the robot made of a fault, by the synthetic world's truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cli.chaos.faults import Fault, Must
from common.geometry import Array

MARGIN_S = 0.05
STILL_M_S = 0.02
FALL_M_S = 0.02
"""Safety's ramp takes more than this from the speed in each of its cycles, and the tracker takes less."""
BRAKES_M_S2 = 1.5
"""Wheels that slow down by more than this are braked to stand."""
RECOVERS_S = 2.0
PATH_M = 0.5
"""Farthest that a robot may ever be from its path, whatever happens."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of one fault; seconds, metres.

    Attributes:
        fault, doing: which, and in what.
        limit_s: how old the input that fails may become, NaN where no fault of it must be noticed.
        stops_s: from the fault until ``command/safe`` began to fall to zero, NaN where it never was zero, or only after
            the base had stopped the wheels for want of it.
        zero_command_s: from the fault until it was zero, NaN likewise.
        brakes_s: from the fault until the wheels were braked, NaN where they never stood.
        standstill_s: from the fault until the wheels stood, NaN where they never did.
        hold: the share of the time from standstill to the fault's end that the wheels stood.
        moving_s: from the fault's end until the robot moved again, NaN where it did not within the time given.
        resumed: whether an operator had to resume.
        offset_m: farthest from the path.
        passed: whether all of it is as it must be; ``why`` says what is not.
    """

    fault: str
    doing: str
    limit_s: float
    stops_s: float
    zero_command_s: float
    brakes_s: float
    standstill_s: float
    hold: float
    moving_s: float
    resumed: bool
    offset_m: float
    passed: bool
    why: str


def unfinished(fault: Fault, doing: str, why: str) -> Outcome:
    """The outcome of a run in which the robot could not be brought to drive, before the fault or after it."""
    nan = float("nan")
    times = {
        "limit_s": nan,
        "stops_s": nan,
        "zero_command_s": nan,
        "brakes_s": nan,
        "standstill_s": nan,
        "moving_s": nan,
    }
    return Outcome(fault.name, doing, **times, hold=1.0, resumed=False, offset_m=0.0, passed=False, why=why)


@dataclass(frozen=True, slots=True)
class Track:
    """What was seen of a run: times (s, from the fault on) and values.

    Attributes:
        times, speed: (N,) of the wheels, m/s.
        safe_times, safe: (M,) the commanded speed that reached the base.
        offset_m: farthest from the path.
    """

    times: Array
    speed: Array
    safe_times: Array
    safe: Array
    offset_m: float


def judge(fault: Fault, doing: str, track: Track, ended: float, braking_s: float, *, resumed: bool) -> Outcome:
    """The outcome of a run; ``ended`` is when the fault did, ``braking_s`` what the robot needs from full speed."""
    during = track.times <= ended
    still = np.abs(track.speed) <= STILL_M_S
    standstill = _first(track.times[during & still])
    held = during & (track.times >= standstill)
    hold = float(still[held].mean()) if held.any() else 1.0
    moving = _first(track.times[~during & ~still]) - ended
    zero = _first(track.safe_times[(track.safe_times <= ended) & (np.abs(track.safe) < 1e-6)])
    stops = _onset(track, zero)
    if zero > standstill:
        stops = zero = float("nan")
    brakes = _braking(track, standstill)
    begins = brakes if np.isnan(stops) else stops
    faults = list(_complaints(fault, begins, standstill, hold, track.offset_m, ended, braking_s))
    return Outcome(
        fault=fault.name,
        doing=doing,
        limit_s=fault.silence_s if fault.must is Must.STOP else float("nan"),
        stops_s=stops,
        zero_command_s=zero,
        brakes_s=brakes,
        standstill_s=standstill,
        hold=hold,
        moving_s=moving,
        resumed=resumed,
        offset_m=track.offset_m,
        passed=not faults,
        why="; ".join(faults),
    )


def _complaints(
    fault: Fault, begins: float, standstill: float, hold: float, offset: float, ended: float, braking: float
) -> list[str]:
    found = []
    limit = fault.silence_s + MARGIN_S
    # What is back before it must be noticed needs no stop.
    if fault.must is Must.STOP and ended > limit + braking:
        if np.isfinite(begins) and begins > limit:
            found.append(f"began to stop after {begins:.2f} s, and may take {limit:.2f} s")
        if not standstill <= limit + braking:
            found.append(f"stood after {standstill:.2f} s, and may take {limit + braking:.2f} s")
    if fault.must is Must.STOP and hold < 0.99:
        found.append(f"stood for {hold:.0%} of the rest of the fault")
    if fault.must is Must.GO and standstill == standstill:  # noqa: PLR0124, NaN is not itself
        found.append("stopped, and need not have")
    if offset > PATH_M:
        found.append(f"was {offset:.2f} m off its path")
    return found


def _onset(track: Track, zero: float) -> float:
    """When the command began to fall, each time by more than :data:`FALL_M_S`, until it was zero."""
    if not np.isfinite(zero):
        return zero
    at, speed = int(np.argmax(track.safe_times >= zero)), np.abs(track.safe)
    at = max(at - 1, 0)  # the last step of a ramp is as small as what is left
    while at > 0 and speed[at - 1] > speed[at] + FALL_M_S:
        at -= 1
    return float(track.safe_times[at])


def _braking(track: Track, standstill: float) -> float:
    """When the wheels began to slow down by more than :data:`BRAKES_M_S2`, until they stood."""
    if not np.isfinite(standstill):
        return standstill
    speed = np.abs(track.speed)
    changes = np.flatnonzero((np.diff(speed) != 0.0) & (track.times[1:] <= standstill)) + 1
    if not len(changes):
        return standstill
    times, speeds = track.times[changes], speed[changes]
    at = len(changes) - 1
    while at > 0 and speeds[at - 1] - speeds[at] > BRAKES_M_S2 * (times[at] - times[at - 1]):
        at -= 1
    return float(times[at])


def _first(times: Array) -> float:
    return float(times[0]) if len(times) else float("nan")
