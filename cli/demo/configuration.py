"""The folder of a demo, and the TOML files of its robots and of their fleet's server."""

from __future__ import annotations

import json
import shutil
import socket
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cli.daylight import Times
from cli.demo.sensor import Sensor
from cli.errors import CommandError
from common.topics import FLEET

ENVIRONMENT = "garden"
ROBOT = "demo"
TEACHER, LEARNER = "demo-1", "demo-2"
"""The robots of a fleet: one that teaches, and one that has never been there."""

_MARK = "# Made by vtr demo.\n"
"""How a file of a demo begins, so that nobody else's is overwritten."""


@dataclass(frozen=True, slots=True)
class FleetLink:
    """How a robot reaches its fleet: the server's router, the storage, and the robot's own credentials for it."""

    router: str
    storage: str
    credentials: Path


def prepare(folder: Path) -> None:
    """Makes the demo's folder, or clears away the robots of the last demo there; what is another's stays untouched.

    Raises:
        CommandError: the folder cannot be written to, holds another robot's configuration, or a demo runs in it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        earlier = [name for name in (ROBOT, TEACHER, LEARNER, FLEET) if _is_earlier_demo(config_file(folder, name))]
        for name in earlier:
            shutil.rmtree(folder / "data" / name, ignore_errors=True)
    except OSError as error:
        raise CommandError(f"cannot write to {folder}: {error.strerror}; give another folder with --output") from None


def config_file(folder: Path, name: str) -> Path:
    """The configuration of a robot of the demo, or of the fleet's server."""
    return folder / ("robot.toml" if name == ROBOT else f"{name}.toml")


def write_config(
    path: Path,
    directory: Path,
    light: Times | None = None,
    sensor: Sensor = Sensor.STEREO,
    *,
    name: str = ROBOT,
    link: FleetLink | None = None,
) -> None:
    """A robot in the synthetic world with everything at its defaults, on a port that is free now.

    With ``light`` the world begins at the time of the teach. Where the repeat has another the sky is clear: the world's
    clouds stand still for hours, as none do, and would be landmarks.
    """
    path.write_text(
        f'{_MARK}[robot]\nname = "{name}"\nsensor = "{sensor}"\nenvironment = "{ENVIRONMENT}"\n'
        f"directory = {json.dumps(str(directory))}\n\n"
        f'[bus]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n{_bus_link(link)}\n'
        f"[console]\nport = {free_port()}\n\n"
        f'[sensors]\ndriver = "synthetic"\nsimulate = ["{sensor.simulated}"]\n{_world_table(light)}{_sync_table(link)}',
        encoding="utf-8",
    )


def write_fleet_config(path: Path, directory: Path, robots: Sequence[str], storage_port: int) -> None:
    """A fleet's server with a storage of its own, which gives each robot its credentials."""
    path.write_text(
        f"{_MARK}[server]\ndirectory = {json.dumps(str(directory))}\n\n"
        f'[bus]\nendpoint = "tcp/127.0.0.1:{free_port()}"\n\n'
        f"[storage]\nport = {storage_port}\nrobots = {json.dumps(list(robots))}\n\n[console]\nport = {free_port()}\n",
        encoding="utf-8",
    )


def free_port() -> int:
    """A port of this machine that nobody listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _is_earlier_demo(config: Path) -> bool:
    """Whether a configuration is there and of a demo that has ended.

    Raises:
        CommandError: it is another's, or its demo is running.
    """
    from cli.supervision.supervised import Supervised

    if not config.exists():
        return False
    if not config.read_text(encoding="utf-8").startswith(_MARK):
        raise CommandError(f"{config} is not of a demo: give another folder with --output")
    if Supervised(config).running():
        raise CommandError(
            f"a demo is running in {config.parent}: wait for its end, or give another folder with --output"
        )
    return True


def _bus_link(link: FleetLink | None) -> str:
    return "" if link is None else f'fleet = "{link.router}"\n'


def _sync_table(link: FleetLink | None) -> str:
    if link is None:
        return ""
    return f'\n[mapstore.sync]\nendpoint = "{link.storage}"\ncredentials = {json.dumps(str(link.credentials))}\n'


def _world_table(light: Times | None) -> str:
    if light is None:
        return ""
    clear = "clouds = 0.0\n" if light.repeat != light.teach else ""
    return f"\n[sensors.world]\ntime = {light.teach.isoformat()}\n{clear}"
