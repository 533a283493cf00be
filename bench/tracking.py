"""Path tracking: the model-predictive follower beside a pure pursuit and a PID, in one closed loop.

All drive the same routes from 0.3 m and 5 degrees beside the start, on a base that slips by 5 %, lags by 0.15 s and
is localized at 10 Hz with 1 cm and 0.3 degrees of noise. All are handed the same path, the same speed profile and the
same predicted pose, and are held to the same limits. Run: ``python -m bench tracking``.
"""

from __future__ import annotations

import argparse
import gc
import itertools
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bench.followers import LawFollower, Pid, PurePursuit
from bench.table import show
from common.geometry import from_xy_yaw
from services.tracker.follower import FollowerSettings, PathFollower
from services.tracker.limits import Drive, Limits
from services.tracker.predict import BaseModel
from services.tracker.simulation import Controller, World, drive, lay_route, true_errors

Array = NDArray[np.float64]
Pieces = Sequence[tuple[float, float]]

START = from_xy_yaw(0.0, 0.3, math.radians(5.0))
SEEDS = (1, 2, 3)
KNOWN = World(longest=150.0)
UNAWARE = World(model=BaseModel(delay=0.0, lag=0.0), base=BaseModel(delay=0.15, lag=0.15), longest=150.0)
CAR = Limits(drive=Drive.ACKERMANN, curvature=0.5)
CURVES = [(8.0, 0.0), (9.0, 9 / 4), (3.0, 0.0), (12.0, -3.0), (10.0, 10 / 6), (3.0, 0.0), (8.0, -8 / 5), (7.0, 0.0)]
CUSPS = [(8.0, 0.0), (4.0, 0.8), (-6.0, 0.8), (5.0, 0.0)]
_LAG = 0.15


@dataclass(frozen=True, slots=True)
class Lane:
    """A route to drive, and the limits of who drives it."""

    name: str
    pieces: Pieces
    limits: Limits = field(default_factory=Limits)

    def taught(self, seed: int) -> Array:
        """The route's vertices (N, 4, 4), shaken by 4 mm and 0.2 degrees as by visual odometry."""
        rng = np.random.default_rng(100 + seed)
        exact = lay_route(self.pieces, 0.4)
        noise = rng.standard_normal((len(exact), 3)) * [0.004, 0.004, math.radians(0.2)]
        return exact @ np.array([from_xy_yaw(x, y, yaw) for x, y, yaw in noise])


LANES = (
    Lane("straight", [(25.0, 0.0)]),
    Lane("curves", CURVES),
    Lane("S-curve", [(7.0, 0.0), (5.0, 2.0), (5.0, -2.0), (5.0, -2.0), (5.0, 2.0), (5.0, 0.0)]),
    Lane("hairpin", [(8.0, 0.0), (1.5 * math.pi, math.pi), (6.0, 0.0), (1.5 * math.pi, -math.pi), (6.0, 0.0)]),
    Lane("cusps", CUSPS),
    Lane("backwards", [(-7.0, 0.0), (-6.0, 1.5), (-4.0, -0.8), (-5.0, 0.0)]),
    Lane("car, curves", CURVES, CAR),
    Lane("car, cusps", CUSPS, CAR),
)

Make = Callable[[Array, Limits], Controller]
"""From the route's poses (N, 4, 4) and limits to a controller."""


def model_predictive(route: Array, limits: Limits) -> Controller:
    """The tracker itself."""
    follower = PathFollower(FollowerSettings(limits=limits))
    follower.set_route(route)

    def control(trunk: int, T_trunk_robot: Array, v: float, w: float, dt: float) -> tuple[float, float, bool]:
        output = follower.update(trunk, T_trunk_robot, 1e-4 * np.eye(6), v, w, 0.0, 0.0, dt)
        return output.v, output.w, output.finished

    return control


def pure_pursuit(route: Array, limits: Limits) -> Controller:
    """The first peer."""
    return LawFollower(route, PurePursuit(), limits, _LAG)


def pid(route: Array, limits: Limits) -> Controller:
    """The second peer."""
    return LawFollower(route, Pid(), limits, _LAG)


FOLLOWERS: dict[str, Make] = {"model-predictive": model_predictive, "pure pursuit": pure_pursuit, "PID": pid}


@dataclass(frozen=True, slots=True)
class Figures:
    """What one drive was like; metres, SI."""

    rms: float
    worst: float
    end: float
    speed: float
    jerk: float
    turn_jerk: float
    finished: bool
    spent: Array
    """Processor time (s) of each cycle."""


def measure(make: Make, lane: Lane, seed: int, world: World) -> Figures:
    """One drive."""
    controller, spent = make(lane.taught(seed), lane.limits), []

    def timed(trunk: int, T_trunk_robot: Array, v: float, w: float, dt: float) -> tuple[float, float, bool]:
        begin = time.thread_time()
        command = controller(trunk, T_trunk_robot, v, w, dt)
        spent.append(time.thread_time() - begin)
        return command

    run = drive(timed, lay_route(lane.pieces, 0.4), START, replace(world, seed=seed))
    dense = lay_route(lane.pieces, 0.02)
    along, lateral = true_errors(run.pose, dense)
    late = lateral[along > 5.0]
    jerk, turn_jerk = (float(np.sqrt(np.mean((np.diff(c, 2) / world.control_period**2) ** 2))) for c in run.command.T)
    return Figures(
        rms=float(np.sqrt(np.mean(late**2))),
        worst=float(np.abs(late).max()),
        end=float(np.linalg.norm(run.pose[-1, :2] - dense[-1, :2, 3])),
        speed=float(along[-1] / (len(run.pose) * world.control_period)),
        jerk=jerk,
        turn_jerk=turn_jerk,
        finished=run.finished,
        spent=np.array(spent),
    )


def compare(world: World, followers: dict[str, Make], lanes: Iterable[Lane] = LANES) -> list[list[object]]:
    """Rows of route, follower, and the means over the seeds; of the greatest error and the end the worst."""
    rows: list[list[object]] = []
    for lane in lanes:
        for name, make in followers.items():
            runs = [measure(make, lane, seed, world) for seed in SEEDS]
            rms, speed, jerk, turn = (
                float(np.mean([getattr(run, key) for run in runs])) for key in ("rms", "speed", "jerk", "turn_jerk")
            )
            worst, end = (100.0 * max(getattr(run, key) for run in runs) for key in ("worst", "end"))
            lost = "" if all(run.finished for run in runs) else "not finished"
            rows.append([lane.name, name, 100.0 * rms, worst, end, speed, jerk, turn, lost])
    return rows


def timing() -> list[list[object]]:
    """Rows of follower and its processor time a cycle, over the curves driven again and again."""
    long, rows = Lane("long", [*CURVES, *CURVES, *CURVES, *CURVES]), []
    for name, make in FOLLOWERS.items():
        gc.collect()
        spent = 1e3 * np.concatenate([measure(make, long, seed, KNOWN).spent for seed in SEEDS])
        rows.append([name, len(spent), *(float(np.percentile(spent, q)) for q in (50, 99, 99.9, 100))])
    return rows


def tune() -> None:
    """Prints the gains of least lateral error of each peer, over all routes."""
    grids: dict[str, Iterable[tuple[float, ...]]] = {
        "pure pursuit": itertools.product((0.3, 0.45, 0.6, 0.8, 1.0), (0.2, 0.35, 0.5, 0.7)),
        "PID": itertools.product((0.75, 1.5, 3.0, 5.0), (0.0, 0.1, 0.4), (1.5, 2.0, 3.0, 4.0)),
    }
    laws: dict[str, Callable[..., PurePursuit | Pid]] = {"pure pursuit": PurePursuit, "PID": Pid}
    rows: list[list[object]] = []
    for name, grid in grids.items():
        found = []
        for gains in grid:

            def make(route: Array, limits: Limits, name: str = name, gains: tuple[float, ...] = gains) -> Controller:
                return LawFollower(route, laws[name](*gains), limits, _LAG)

            runs = [measure(make, lane, seed, KNOWN) for lane in LANES for seed in SEEDS[:2]]
            rms, jerk = (float(np.mean([getattr(run, key) for run in runs])) for key in ("rms", "turn_jerk"))
            found.append((rms, jerk, str(gains)))
        rows += [[name, gains, rms, jerk] for rms, jerk, gains in sorted(found)[:5]]
    show("Gains of the peers", ["follower", "gains", "RMS m", "rad/s3"], rows)


def main(arguments: Sequence[str] = ()) -> None:
    """Prints the tables: of each world, and of the time."""
    parser = argparse.ArgumentParser(prog="python -m bench.tracking", description=__doc__)
    parser.add_argument("--tune", action="store_true", help="search the peers' gains instead")
    if parser.parse_args(arguments).tune:
        tune()
        return
    columns = ["route", "follower", "RMS cm", "max cm", "end cm", "m/s", "jerk m/s3", "rad/s3", ""]
    note = "means over the seeds, of max and end the worst; errors count from 5 m on; jerk is the commands' RMS"
    for base, world in (("delay and lag known", KNOWN), ("0.15 s of delay and of lag, unknown", UNAWARE)):
        show(f"Following routes with slip: {base}", columns, compare(world, FOLLOWERS), note)
    show("Processor time a cycle, ms", ["follower", "cycles", "p50", "p99", "p99.9", "max"], timing())


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
