"""The evaluation itself: drives are rendered, processed and taught once, then each is localized on every other.

Both passes run in a :class:`~cli.leave_one_out.pool.Pool`; what the first has made waits on disk for the second.
"""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import lru_cache
from pathlib import Path

import numpy as np

from cli.daylight import moment
from cli.errors import CommandError
from cli.leave_one_out.pool import Pool, advance
from cli.leave_one_out.results import BASELINE, COMBINED, EXPERIENCED, Localized, Outcome, Results
from services.estimator.offline import LocalizationRun, Processed, Route, process
from services.estimator.settings import Settings
from services.estimator.stereo.streams import INVARIANT, PLAIN
from services.sensors.world import SceneSettings, World, WorldSettings, sun_angles
from services.sensors.world.traversal import DrivingSettings, Traversal

_SEED_STEP = 1000
"""Between the seeds of two drives of a study, so that studies of neighbouring seeds share no drive."""


WORLD = WorldSettings(clouds=0.0, scene=SceneSettings(trees=80))
"""The demo's world with twice the trees, whose shadows wander over the route all day.

Under a clear sky: no cloud stands still for hours, as a landmark.
"""
_KEPT = 4
"""Processed drives that a process keeps in memory, of 200 MB or so each."""


@dataclass(frozen=True, slots=True)
class Study:
    """What is driven.

    Attributes:
        times: of the drives.
        estimator: the estimator's settings.
        driving: how the route is driven.
        seed: of the drives' sway and their cameras' noise.
        wind: whether leaves and grass stand otherwise on every drive, and cast other shadows.
        experiences: repeats at other times that the combined system is given in its map, in a run of its own; 0: none.
    """

    times: tuple[datetime, ...]
    estimator: Settings
    driving: DrivingSettings
    seed: int
    wind: bool = True
    experiences: int = 0

    def steps(self) -> int:
        """How often a frame is processed or localized in all, about."""
        length = self.driving.length or WORLD.scene.route_length
        frames = round(min(length, WORLD.scene.route_length) / self.driving.spacing)
        drives = len(self.times)
        runs = 2 + (1 + self.experiences if self.experiences else 0)
        return frames * (drives + runs * drives * (drives - 1))

    def recorded(self, live: int, taught: int) -> list[int]:
        """The drives whose repeats the map holds beside the taught one, spread over the day; never the live one."""
        others = [drive for drive in range(len(self.times)) if drive not in (live, taught)]
        chosen = np.linspace(0, len(others) - 1, min(self.experiences, len(others)))
        return [others[k] for k in np.unique(np.rint(chosen).astype(np.int64))]


def times_of_day(first: str, last: str, count: int) -> tuple[datetime, ...]:
    """``count`` moments from one clock time (HH:MM, UTC) of the world's day to another, to the minute.

    Raises:
        CommandError: one is no time of day, the sun is down then, or the last is not after the first.
    """
    begin, end = moment(first, "--first", WORLD), moment(last, "--last", WORLD)
    if begin + timedelta(minutes=count) > end:
        raise CommandError(f"--last: {last} must be at least {count} minutes after --first, {first}")
    step = (end - begin) / (count - 1)
    return tuple((begin + k * step).replace(second=0, microsecond=0) for k in range(count))


@dataclass(frozen=True, slots=True)
class _Task:
    """One drive of a study, and the folder where the processed drives are."""

    study: Study
    folder: Path
    drive: int

    def file(self, drive: int) -> Path:
        """Where a processed drive is kept."""
        return self.folder / f"{drive}.pickle"


def evaluate(study: Study, folder: Path, processes: int, on_progress: Callable[[int], None]) -> Results:
    """Every drive localized on every other one; a gigabyte or so is in ``folder`` meanwhile.

    ``on_progress`` is told how many of :meth:`Study.steps` are done.

    Raises:
        CommandError: a process was killed, or a drive shows nothing that could be taught.
    """
    numbers = range(len(study.times))
    with tempfile.TemporaryDirectory(dir=folder, prefix=".drives-") as work, Pool(processes, on_progress) as pool:
        tasks = [_Task(study, Path(work), drive) for drive in numbers]
        pool.map(_process, tasks)
        localized = pool.map(_localize, tasks)
    elevations = [sun_angles(time, WORLD.latitude, WORLD.longitude)[1] for time in study.times]
    return Results(
        times=study.times,
        elevations=tuple(float(np.degrees(angle)) for angle in elevations),
        localized=tuple(one for of_live in localized for one in of_live),
    )


@lru_cache(maxsize=1)
def _world(wind: int) -> World:
    """This process's world, in one of the wind's arrangements; it takes seconds to build."""
    return World(replace(WORLD, scene=replace(WORLD.scene, wind=wind)))


def _process(task: _Task) -> None:
    """Renders a drive and puts it through preprocessing and odometry."""
    study = task.study
    world = _world(1 + task.drive if study.wind else 0)
    traversal = Traversal.of(world, study.times[task.drive], study.driving, study.seed * _SEED_STEP + task.drive)
    drive = list(process(traversal, study.estimator, advance))
    with task.file(task.drive).open("wb") as file:
        pickle.dump(drive, file, protocol=pickle.HIGHEST_PROTOCOL)


@lru_cache(maxsize=_KEPT)
def _processed(file: Path) -> list[Processed]:
    with file.open("rb") as stored:
        drive: list[Processed] = pickle.load(stored)  # noqa: S301, this very command has written it
    return drive


def _localize(task: _Task) -> list[Localized]:
    """One drive on every other one."""
    return [_on(task, taught) for taught in range(len(task.study.times)) if taught != task.drive]


def _on(task: _Task, taught: int) -> Localized:
    """One drive on one taught: by the baseline, by the combined system, and with experiences in the map."""
    study, live = task.study, _processed(task.file(task.drive))
    route = Route(WORLD.camera, study.estimator)
    try:
        route.teach(_processed(task.file(taught)))
    except ValueError as error:
        raise CommandError(f"the drive at {study.times[taught]:%H:%M}: {error}") from None
    runs = {BASELINE: route.repeat(_counted(_plain(live))), COMBINED: route.repeat(_counted(live))}
    if study.experiences:
        for other in study.recorded(task.drive, taught):
            route.repeat(_counted(_processed(task.file(other))), record=True)
        runs[EXPERIENCED] = route.repeat(_counted(live))
    combined = runs[COMBINED]
    return Localized(
        live=task.drive,
        taught=taught,
        distance=combined.distance,
        invariant=combined.streams.get(INVARIANT, np.zeros_like(combined.success)),
        outcomes={system: _outcome(run) for system, run in runs.items()},
    )


def _outcome(run: LocalizationRun) -> Outcome:
    position, rotation = run.position_errors, run.rotation_errors
    assert position is not None  # noqa: S101, a world knows the truth
    assert rotation is not None  # noqa: S101
    return Outcome(run.success, position, rotation)


def _plain(drive: Iterable[Processed]) -> Iterator[Processed]:
    """The drive as a robot has it that knows no invariant stream."""
    for processed in drive:
        step = replace(processed.step, live={PLAIN: processed.step.live[PLAIN]})
        yield replace(processed, step=step)


def _counted(drive: Iterable[Processed]) -> Iterator[Processed]:
    for processed in drive:
        yield processed
        advance()
