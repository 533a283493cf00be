"""The two demos: one robot that teaches and repeats, and two robots that share a map through their fleet's server."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from cli.daylight import Times
from cli.demo.configuration import LEARNER, ROBOT, TEACHER, config_file, write_config
from cli.demo.driver import DriverSettings
from cli.demo.fleet import DemoFleet
from cli.demo.recorder import Recording
from cli.demo.report import Shared
from cli.demo.sensor import Sensor
from cli.demo.story import Announce, Offset, Progress, Story
from common.geometry import Array
from common.ids import VertexId

_SHARE_S = 60.0


@dataclass(frozen=True, slots=True)
class Told:
    """What was recorded of the teach and of the repeat and, where two robots shared a map, how that went."""

    taught: Recording
    repeated: Recording
    shared: Shared | None = None


def one_robot(
    folder: Path,
    light: Times,
    sensor: Sensor,
    driver: DriverSettings,
    offset: Offset,
    progress: Progress,
    announce: Announce,
) -> Told:
    """A robot is taught a route, is put back beside its start, and repeats it."""
    config = config_file(folder, ROBOT)
    write_config(config, folder / "data", light, sensor)
    with Story(config, progress, announce=announce) as story:
        map_id, taught = story.teach(story.route(), driver)
        if light.repeat != light.teach:
            story.set_time(light.repeat)
        start = taught.poses()[0]
        repeated = story.repeat(start, offset, taught.driven_metres(), _patience(taught), VertexId(map_id, 0))
    return Told(taught, repeated)


def two_robots(
    folder: Path,
    light: Times,
    sensor: Sensor,
    driver: DriverSettings,
    offset: Offset,
    progress: Progress,
    announce: Announce = lambda _address: None,
    route: Array | None = None,
) -> Told:
    """A robot is taught a route; another one, which was never there, fetches the map from the fleet and repeats it.

    ``route`` (N, 3) of x, y, yaw is driven in place of the whole one. The first robot's processes end before the second
    one's begin: this machine's cores are enough for one.
    """
    with DemoFleet(folder, (TEACHER, LEARNER), progress) as fleet:
        for name in (TEACHER, LEARNER):
            write_config(config_file(folder, name), folder / "data", light, sensor, name=name, link=fleet.link(name))
        with Story(config_file(folder, TEACHER), progress, announce=announce) as story:
            map_id, taught = story.teach(story.route() if route is None else route, driver)
            finished = time.monotonic()
            summary = story.await_shared(map_id, _SHARE_S)
            shared_s = time.monotonic() - finished
        with Story(config_file(folder, LEARNER), progress, announce=announce) as story:
            if light.repeat != light.teach:
                story.set_time(light.repeat)
            asked = time.monotonic()
            repeated = story.repeat(taught.poses()[0], offset, taught.driven_metres(), _patience(taught), "start")
            own = story.maps()[-1]
            if own.record.generation > 0:
                story.await_shared(own.record.id, _SHARE_S)
        catalog = fleet.catalog()
    return Told(
        taught,
        repeated,
        Shared(
            map=map_id,
            teacher=TEACHER,
            learner=LEARNER,
            megabytes=round(summary.bytes / 1e6, 2),
            shared_s=round(shared_s, 2),
            fetched_s=round(repeated.first_followed - asked, 2),
            in_catalog=len(catalog),
        ),
    )


def _patience(taught: Recording) -> float:
    """Seconds that a repeat may take."""
    return 3.0 * taught.driving_seconds() + 30.0
