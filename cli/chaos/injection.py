"""Faults inside of a process: its messages, its clock, its interpreter, its disk."""

from __future__ import annotations

import contextlib
import ctypes
import random
import resource
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from cli.chaos.orders import Order
from common.bus import session
from common.messages import LidarScan, Message, StereoFrame, now_ns

_Send = Callable[[Message], None]


class Injector:
    """What is wrong in this process now; nothing, to begin with."""

    def __init__(self) -> None:
        self._order = Order(kind="none")
        self._kept: dict[int, Message] = {}
        self._random = random.Random(1)  # noqa: S311, chance for tests
        self._true_time_ns = time.time_ns

    def install(self) -> None:
        """Puts itself between the service and the bus, and before the clock."""
        put = session.Publisher.put
        injector = self

        def meddled(publisher: session.Publisher[Any], message: Message) -> None:
            injector.pass_on(publisher.key, message, lambda one: put(publisher, one), id(publisher))

        session.Publisher.put = meddled  # type: ignore[method-assign,assignment]
        time.time_ns = self._time_ns

    def obey(self, order: Order) -> None:
        """Takes an order; what lasts lasts until the next one."""
        self._kept.clear()
        self._order = order
        if order.kind == "hold":
            _hold_interpreter(order.amount)
        elif order.kind in {"full", "none"}:
            _limit_files(full=order.kind == "full")

    def pass_on(self, key: str, message: Message, send: _Send, publisher: int) -> None:
        """Sends a message as it is, changed, late, twice, in another order, or not at all."""
        order = self._order
        if order.key not in key or order.kind == "none":
            send(message)
            return
        match order.kind:
            case "drop":
                return
            case "lose" if self._random.random() < order.amount:
                return
            case "delay":
                threading.Timer(order.amount, _send_quietly, (send, message)).start()
                return
            case "double":
                send(message)
            case "reorder":
                kept = self._kept.pop(publisher, None)
                if kept is None:
                    self._kept[publisher] = message
                    return
                send(message)
                message = kept
            case "freeze":
                message = _frozen(self._kept.setdefault(publisher, message), message)
            case "black" | "extrinsics":
                message = _spoilt(message, order)
            case _:
                pass
        send(message)

    def _time_ns(self) -> int:
        order = self._order
        return self._true_time_ns() + (round(order.amount * 1e9) if order.kind == "clock" else 0)


def _send_quietly(send: _Send, message: Message) -> None:
    """A late message may find its session closed: then it is lost, as it would be on the way."""
    with contextlib.suppress(Exception):
        send(message)


def _frozen(first: Message, now: Message) -> Message:
    """The first frame again, with the stamp of now: a camera that repeats its last picture."""
    return first.model_copy(update={"stamp": getattr(now, "stamp", now_ns())})


def _spoilt(message: Message, order: Order) -> Message:
    """A frame that is black, or whose extrinsics are turned by ``amount`` radians about the vertical."""
    if isinstance(message, StereoFrame) and order.kind == "black":
        black = np.zeros_like(message.left)
        return message.model_copy(update={"left": black, "right": black})
    if isinstance(message, LidarScan) and order.kind == "black":
        return message.model_copy(update={"ranges": np.zeros_like(message.ranges)})
    if isinstance(message, StereoFrame):
        turned = message.camera.model_copy(
            update={"T_vehicle_camera": _turn(order.amount) @ message.camera.T_vehicle_camera}
        )
        return message.model_copy(update={"camera": turned})
    if isinstance(message, LidarScan):
        return message.model_copy(update={"T_vehicle_lidar": _turn(order.amount) @ message.T_vehicle_lidar})
    return message


def _turn(yaw: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    T = np.eye(4)
    T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    return T


def _hold_interpreter(seconds: float) -> None:
    """Sleeps in native code without letting go of the interpreter: no thread of this process runs meanwhile."""
    ctypes.PyDLL(None).usleep(ctypes.c_uint(round(seconds * 1e6)))


def _limit_files(*, full: bool) -> None:
    """No file of this process may grow any longer, as on a full disk; or any may again."""
    _, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 if full else hard, hard))
