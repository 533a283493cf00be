"""ROS's quality of service, as far as it is seen on Zenoh."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Qos:
    """Quality of service of an endpoint: ``depth`` samples are kept, and no deadline is promised.

    Attributes:
        reliable: reliable, or best effort.
        latched: transient local, so that a late joiner gets the last ``depth`` samples, or volatile.
        depth: of the history.
    """

    reliable: bool = True
    latched: bool = False
    depth: int = 10

    def encode(self) -> str:
        """As in a liveliness token: ``<reliability>:<durability>:<history>,<depth>`` in the numbers of ``rmw``.

        Then follow deadline, lifespan and liveliness, which are at their defaults where nothing stands.
        """
        return f"{1 if self.reliable else 2}:{1 if self.latched else 2}:1,{self.depth}:,:,:,,"


SENSOR_DATA = Qos(reliable=False, depth=5)
"""``rmw_qos_profile_sensor_data``: a newer sample is worth more than a lost one."""
DEFAULT = Qos()
COMMAND = Qos(depth=1)
LATCHED = Qos(latched=True, depth=1)
STATIC_TRANSFORMS = Qos(latched=True, depth=100)
"""Each node that knows static transforms sends a message of its own."""
TRANSFORMS = Qos(depth=100)
