"""What ``vtr doctor`` hears on a robot's bus: each topic at its rate, each process present, the fleet's clock."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING

from cli import client
from cli.doctor.check import Check
from cli.doctor.storage import storage_of
from cli.processes import Process, table_of
from cli.supervision import endpoints
from common import topics
from common.access.link import client_settings
from common.bus import Bus
from common.config import RobotConfig
from common.errors import ConfigurationError, NoRouter
from common.messages import State, StateName, now_ns
from common.topics import FLEET, Topic
from services.estimator.settings import Settings as EstimatorSettings
from services.safety.settings import Settings as SafetySettings
from services.sensors.settings import Settings as SensorSettings

if TYPE_CHECKING:
    from common.bus import Presence

LISTEN_S = 3.0
SLOWEST = 0.7
"""Share of its expected rate below which a topic is too slow."""
MOST_SECONDS = 2.0
"""By which clocks may be apart. Maps are chosen by the hour, but told apart, and their uploads signed, by the clock."""

_PRESENCE_S = 0.3
_OTHER_PORT = "set another endpoint in [bus]"
_FRAMES = {"stereo": topics.STEREO, "lidar": topics.LIDAR, "bearing": topics.CAMERA}
_REPEATING = (topics.LOCALIZATION, topics.DESIRED, topics.TRACKER_STATUS)

Wanted = list[tuple[Topic, str, float]]
"""Topics, the name in the key of each, and the samples a second that are expected of it."""


def check_bus(configuration: RobotConfig) -> list[Check]:
    """Whether the router's port is free, or answered by the robot's own router; then what is said on it."""
    endpoint = configuration.bus.endpoint
    try:
        address = endpoints.parse(endpoint)
        if not address.answers(1.0):
            address.check_free()
            return [Check("router", "ok", f"{endpoint} is free; {configuration.who} is down")]
        with client.connect(configuration) as bus:
            return _running(configuration, bus)
    except NoRouter:
        return [Check("router", "fail", f"{endpoint} is used by a program that is no router", _OTHER_PORT)]
    except ConfigurationError as error:
        return [Check("router", "fail", str(error), _OTHER_PORT)]


def _running(configuration: RobotConfig, bus: Bus) -> list[Check]:
    presence = bus.presence()
    time.sleep(_PRESENCE_S)
    if "router" not in presence:
        text = f"{configuration.bus.endpoint} belongs to another robot than '{configuration.robot.name}'"
        return [Check("router", "fail", text, _OTHER_PORT)]
    router = Check("router", "ok", f"{configuration.bus.endpoint} answers")
    checks = [router, _present(table_of(configuration), presence)]
    if not configuration.of_fleet:
        checks.append(_rates(bus, _wanted(configuration, bus)))
    return checks


def _present(table: Sequence[Process], presence: Presence) -> Check:
    alive = presence.alive() | ({"sensors"} if "player" in presence else set())
    missing = [process.name for process in table if process.name not in alive]
    if missing:
        return Check("processes", "fail", f"not present: {', '.join(missing)}", "see vtr ps, and their logs")
    return Check("processes", "ok", "every process is present")


def _wanted(configuration: RobotConfig, bus: Bus) -> Wanted:
    """What has to be said in the robot's present state."""
    estimator = configuration.settings("estimator", EstimatorSettings)
    sensor = configuration.robot.sensor
    frames = _FRAMES[sensor]
    camera = estimator.scanner if sensor == "lidar" else estimator.camera
    rate = frames.rate_hz if sensor == "lidar" else configuration.settings("sensors", SensorSettings).frame_rate
    wanted = [(frames, camera, rate), *((topic, "", topic.rate_hz) for topic in _steady(configuration))]
    of_frames = [topics.ODOMETRY]
    if "obstacles" in configuration.tables:
        of_frames.append(topics.OBSTACLES)
    if _state(bus) is StateName.REPEAT_FOLLOW:
        of_frames += _REPEATING
    return wanted + [(topic, "", min(rate, topic.rate_hz)) for topic in of_frames]


def _steady(configuration: RobotConfig) -> list[Topic]:
    found = [topics.WHEEL_ODOMETRY, topics.STATE, topics.SAFE, topics.SAFETY_STATUS]
    if configuration.settings("safety", SafetySettings).rules.dead_mans_switch:
        found.append(topics.JOYSTICK)
    return found


def _state(bus: Bus) -> StateName | None:
    subscription = bus.subscribe(topics.STATE)
    try:
        received = subscription.wait(1.0)
    finally:
        subscription.close()
    message: State | None = None if received is None else received.message
    return None if message is None else message.name


def _rates(bus: Bus, wanted: Wanted) -> Check:
    """Counts what comes in some seconds."""
    tap = bus.tap((topic, name) for topic, name, _ in wanted)
    counts: Counter[str] = Counter()
    end = time.monotonic() + LISTEN_S
    while time.monotonic() < end:
        while (sample := tap.take()) is not None:
            counts[sample.key] += 1
        time.sleep(0.02)
    silent, slow = [], []
    for topic, name, expected in wanted:
        key = topic.key.format(name=name)
        rate = counts[key] / LISTEN_S
        if counts[key] == 0:
            silent.append(f"nobody publishes {key} (that is {' or '.join(topic.owners)})")
        elif rate < SLOWEST * expected:
            slow.append(f"{key} comes at {rate:.1f} Hz instead of {expected:g}")
    if silent or slow:
        advice = "see vtr ps and the log of who should" if silent else "see CPU in vtr ps: a slower rate may do"
        return Check("topics", "fail" if silent else "warn", "; ".join(silent + slow), advice)
    return Check("topics", "ok", f"all {len(wanted)} come at their rates")


def check_fleet_clock(configuration: RobotConfig) -> list[Check]:
    """How far this clock is from the fleet's: by its server's health reports, else by the storage's answers."""
    if configuration.of_fleet:
        return []
    seconds = _by_health(configuration) if configuration.bus.fleet is not None else None
    source = configuration.bus.fleet
    if seconds is None and (storage := storage_of(configuration)) is not None:
        seconds, source = _by_date(storage.endpoint), storage.endpoint
    if seconds is None:
        return []
    text = f"{abs(seconds):.1f} s {'ahead of' if seconds > 0 else 'behind'} {source}"
    if abs(seconds) > MOST_SECONDS:
        return [Check("fleet's clock", "fail", text, "set this clock, or the fleet's: run a time service on both")]
    return [Check("fleet's clock", "ok", text)]


def _by_health(configuration: RobotConfig) -> float | None:
    """Seconds that this clock is ahead of the fleet's server, heard through the robot's router; None if it is not."""
    table = configuration.bus
    try:
        if not endpoints.parse(table.endpoint).answers(1.0):
            return None
        access = client_settings(configuration, client.OPERATOR)
        with Bus(FLEET, client.OPERATOR, table.endpoint, shared_memory=False, timeout=1.0, access=access) as bus:
            received = bus.subscribe(topics.HEALTH).wait(2.5)
    except (NoRouter, ConfigurationError):
        return None
    return None if received is None else (now_ns() - received.message.stamp) / 1e9


def _by_date(endpoint: str) -> float | None:
    """Seconds that this clock is ahead of the ``Date`` of an HTTP server, which has whole ones; None without one."""
    import urllib3
    from urllib3.exceptions import HTTPError

    pool = urllib3.PoolManager(timeout=2.0, retries=False, cert_reqs="CERT_NONE")
    try:
        before = time.time()
        told = pool.request("HEAD", endpoint, redirect=False).headers.get("Date")
        there = None if told is None else parsedate_to_datetime(told).timestamp() + 0.5
    except (HTTPError, ValueError, TypeError):
        return None
    return None if there is None else (before + time.time()) / 2 - there
