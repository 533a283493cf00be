"""How the fault tests tell a process what to do wrong: datagrams of JSON on a socket of the robot's folder."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict

from cli.errors import CommandError
from common.config import RobotConfig

Kind = Literal[
    "none", "hold", "clock", "drop", "lose", "delay", "double", "reorder", "freeze", "black", "extrinsics", "full"
]  # fmt: skip


class Order(BaseModel):
    """A fault, and its size where it has one: seconds, or a share of messages.

    ``none`` ends all others. ``key`` is the part of a topic's key whose samples are meddled with.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: Kind
    amount: float = 0.0
    key: str = ""


def socket_of(configuration: RobotConfig, process: str) -> Path:
    """Where a process listens."""
    return configuration.directory / "run" / f"chaos-{process}.sock"


def listen(path: Path, obey: Callable[[Order], None]) -> None:
    """Obeys every order that arrives, in a thread of its own, for as long as the process lives."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)
    ear = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    ear.bind(str(path))

    def hear() -> None:
        while True:
            obey(Order.model_validate_json(ear.recv(4096)))

    threading.Thread(target=hear, name="chaos", daemon=True).start()


def send(configuration: RobotConfig, process: str, order: Order) -> None:
    """Gives an order to a process.

    Raises:
        CommandError: it does not listen.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as mouth:
        try:
            mouth.sendto(json.dumps(order.model_dump()).encode(), str(socket_of(configuration, process)))
        except OSError as error:
            raise CommandError(f"'{process}' takes no orders: {error.strerror}") from None
