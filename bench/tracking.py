"""Path tracking: the model-predictive follower beside a pure pursuit and a PID, in one closed loop.

All three drive the same 60 m with curves of 4 to 6 m radius, from 0.3 m and 5 degrees beside the start, on a base
that slips by 5 %, lags by 0.15 s and is localised at 10 Hz with 1 cm and 0.3 degrees of noise. All are handed the
same path, the same speed profile and the same predicted pose, and are held to the same limits. Run: ``python -m
bench.tracking``.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.table import show
from common.geometry import from_xy_yaw
from services.tracker.follower import PathFollower
from services.tracker.limits import Limits
from services.tracker.path import Projection, Section, make_path
from services.tracker.predict import BaseModel
from services.tracker.simulation import Controller, Run, World, drive, lay_route, true_errors
from services.tracker.speed import speed_profile

Array = NDArray[np.float64]

CURVES = [(8.0, 0.0), (9.0, 9 / 4), (3.0, 0.0), (12.0, -3.0), (10.0, 10 / 6), (3.0, 0.0), (8.0, -8 / 5), (7.0, 0.0)]
START = from_xy_yaw(0.0, 0.3, math.radians(5.0))
SEEDS = (1, 2, 3)
UNAWARE = World(model=BaseModel(delay=0.0, lag=0.0), base=BaseModel(delay=0.15, lag=0.15))
Law = Callable[[Section, Projection, float, float], float]
"""From section, place, speed and dt to the turn rate."""


def taught_route(seed: int) -> Array:
    """The route's vertices (N, 4, 4), shaken by 4 mm and 0.2 degrees as by visual odometry."""
    rng = np.random.default_rng(100 + seed)
    exact = lay_route(CURVES, 0.4)
    noise = rng.standard_normal((len(exact), 3)) * [0.004, 0.004, math.radians(0.2)]
    return exact @ np.array([from_xy_yaw(x, y, yaw) for x, y, yaw in noise])


def model_predictive(route: Array) -> Controller:
    """The tracker itself."""
    follower = PathFollower()
    follower.set_route(route)

    def control(trunk: int, T_trunk_robot: Array, v: float, w: float, dt: float) -> tuple[float, float, bool]:
        output = follower.update(trunk, T_trunk_robot, 1e-4 * np.eye(6), v, w, 0.0, 0.0, dt)
        return output.v, output.w, output.finished

    return control


def with_law(route: Array, law: Law) -> Controller:
    """A steering law with the tracker's own speed profile and limits around it."""
    limits, path = Limits(), make_path(route)
    section = path.sections[0]
    profile = speed_profile(section.s, section.curvature, limits)
    last = [0.0, 0.0]

    def control(trunk: int, T_trunk_robot: Array, v: float, _w: float, dt: float) -> tuple[float, float, bool]:
        place = path.project(0, trunk, path.place(trunk, T_trunk_robot))
        left = section.end - place.s
        # Look as far ahead as the base's lag, as braking on the spot of the profile comes late.
        wanted = min(max(float(np.interp(place.s + 0.15 * v, section.s, profile)), 0.08), limits.speed) * (left > 0.02)
        last[0] += min(max(wanted - last[0], -limits.deceleration * dt), limits.acceleration * dt)
        turn = min(max(law(section, place, last[0], dt), -limits.turn_rate), limits.turn_rate)
        last[1] += min(max(turn - last[1], -limits.turn_acceleration * dt), limits.turn_acceleration * dt)
        return last[0], last[1] * (left > 0.02), left <= 0.02 and abs(v) < 0.03

    return control


def pure_pursuit(route: Array) -> Controller:
    """Steers along the arc to a point 0.6 m + 0.5 s ahead on the path (Coulter, 1992)."""

    def law(section: Section, place: Projection, v: float, _dt: float) -> float:
        s = min(max(place.s, section.start), section.end)
        ahead = 0.6 + 0.5 * v
        goal = min(s + ahead, section.end)
        here, there = (np.array([np.interp(at, section.s, c) for c in (section.x, section.y)]) for at in (s, goal))
        tangent = float(np.interp(s, section.s, section.heading))
        robot = here + place.lateral * np.array([-math.sin(tangent), math.cos(tangent)])
        bearing = math.atan2(*(there - robot)[::-1]) - tangent - place.heading
        return v * 2.0 * math.sin(bearing) / max(float(np.linalg.norm(there - robot)), 0.3)

    return with_law(route, law)


def pid(route: Array) -> Controller:
    """Feed-forward of the curvature with a PID on the lateral error (its rate is the heading error times the speed)."""
    integral = [0.0]

    def law(section: Section, place: Projection, v: float, dt: float) -> float:
        integral[0] = min(max(integral[0] + place.lateral * dt, -0.3), 0.3)
        feed = v * float(np.interp(place.s, section.s, section.curvature))
        return feed - 1.5 * place.lateral - 2.0 * v * place.heading - 0.1 * integral[0]

    return with_law(route, law)


@dataclass(frozen=True, slots=True)
class Figures:
    """What one drive was like; metres, SI."""

    rms: float
    worst: float
    converged: float
    end: float
    speed: float
    jerk: float
    turn_jerk: float
    milliseconds: float


def measure(make: Callable[[Array], Controller], seed: int, world: World) -> Figures:
    """One drive."""
    controller, spent = make(taught_route(seed)), []

    def timed(trunk: int, T_trunk_robot: Array, v: float, w: float, dt: float) -> tuple[float, float, bool]:
        begin = time.thread_time()
        command = controller(trunk, T_trunk_robot, v, w, dt)
        spent.append(time.thread_time() - begin)
        return command

    run = drive(timed, lay_route(CURVES, 0.4), START, world)
    return figures(run, np.array(spent), world.control_period)


def figures(run: Run, spent: Array, period: float) -> Figures:
    """The figures of a run."""
    dense = lay_route(CURVES, 0.02)
    along, lateral = true_errors(run.pose, dense)
    late = lateral[along > 5.0]
    outside = np.flatnonzero(np.abs(lateral[along < 15.0]) > 0.05)
    jerk, turn_jerk = (float(np.sqrt(np.mean((np.diff(c, 2) / period**2) ** 2))) for c in run.command.T)
    return Figures(
        rms=float(np.sqrt(np.mean(late**2))),
        worst=float(np.abs(late).max()),
        converged=float(along[outside[-1]]) if len(outside) else 0.0,
        end=float(np.linalg.norm(run.pose[-1, :2] - dense[-1, :2, 3])),
        speed=float(along[-1] / (len(run.pose) * period)),
        jerk=jerk,
        turn_jerk=turn_jerk,
        milliseconds=float(1e3 * np.median(spent)),
    )


def main() -> None:
    """Prints the table: the mean over the seeds, of the worst errors the maximum."""
    followers = {"model-predictive": model_predictive, "pure pursuit": pure_pursuit, "PID": pid}
    rows: list[list[object]] = []
    for base, world in (("delay known", World()), ("0.15 s unknown delay and lag", UNAWARE)):
        for name, make in followers.items():
            runs = [measure(make, seed, _seeded(world, seed)) for seed in SEEDS]
            mean = {key: float(np.mean([getattr(run, key) for run in runs])) for key in Figures.__slots__}
            worst, end = (100 * max(getattr(run, key) for run in runs) for key in ("worst", "end"))
            figures_ = [100 * mean["rms"], worst, mean["converged"], end]
            rows.append([base, name, *figures_, mean["speed"], mean["jerk"], mean["turn_jerk"], mean["milliseconds"]])
    show(
        "Following a curved route with slip, lag and delay",
        ["base", "follower", "RMS cm", "max cm", "settled m", "end cm", "m/s", "jerk m/s3", "rad/s3", "ms a cycle"],
        rows,
        note="means over the seeds, of max and end the worst; errors count from 5 m on",
    )


def _seeded(world: World, seed: int) -> World:
    return World(base=world.base, model=world.model, seed=seed, longest=120.0)


if __name__ == "__main__":
    main()
