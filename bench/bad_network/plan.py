"""What happens when: partitions of the network, and the operator's emergency stops; all of it follows from a seed."""

from __future__ import annotations

import dataclasses
import json
import random
from dataclasses import dataclass
from typing import Self

PARTITION_S = 30.0
_EVERY_S = 60.0
_FIRST_S = 20.0
_STOPS_EVERY_S = (35.0, 65.0)


@dataclass(frozen=True, slots=True)
class Partition:
    """Seconds from the start between which nothing passes between some robots and the server."""

    begins: float
    ends: float
    robots: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """A run: ``start`` is monotonic time (s), all else counts from there; ``stops`` are (time, robot)."""

    start: float
    seconds: float
    robots: tuple[str, ...]
    delay_s: float
    loss: float
    partitions: tuple[Partition, ...]
    stops: tuple[tuple[float, str], ...]

    @classmethod
    def of(cls, robots: int, seconds: float, delay_s: float, loss: float, seed: int) -> Self:
        """Half of the robots are cut off once a minute, and all of them at the end."""
        chance = random.Random(seed)  # noqa: S311, a bench's dice
        names = tuple(f"r{k + 1}" for k in range(robots))
        partitions, begins = [], _FIRST_S
        while begins + PARTITION_S < seconds - PARTITION_S:
            cut = tuple(sorted(chance.sample(names, max(robots // 2, 1))))
            partitions.append(Partition(begins, begins + PARTITION_S, cut))
            begins += _EVERY_S
        partitions.append(Partition(seconds - PARTITION_S, seconds, names))
        stops = []
        for name in names:
            at = chance.uniform(*_STOPS_EVERY_S)
            while at < seconds - 2.0:
                stops.append((round(at, 2), name))
                at += chance.uniform(*_STOPS_EVERY_S)
        return cls(0.0, seconds, names, delay_s, loss, tuple(partitions), tuple(sorted(stops)))

    def cut(self, robot: str, at: float) -> bool:
        """Whether a robot is cut off at a time from the start."""
        return any(p.begins <= at < p.ends and robot in p.robots for p in self.partitions)

    def text(self) -> str:
        """As JSON, in one line."""
        return json.dumps(dataclasses.asdict(self))

    @classmethod
    def parse(cls, text: str) -> Self:
        """Inverse of :meth:`text`."""
        content = json.loads(text)
        partitions = tuple(Partition(p["begins"], p["ends"], tuple(p["robots"])) for p in content["partitions"])
        stops = tuple((at, robot) for at, robot in content["stops"])
        return cls(**{**content, "robots": tuple(content["robots"]), "partitions": partitions, "stops": stops})
