"""ROS 1 and ROS 2 bags, through ``rosbags``.

* ``mapping``: which of a bag's topics becomes which of ours, as told, or by type and name.
* ``images``, ``clouds``, ``frames``: what is in ROS's messages.
* ``bag``: a bag as a drive.
"""

from services.sensors.recordings.ros.bag import BagTimeline, is_bag, open_bag
from services.sensors.recordings.ros.mapping import parse_map

__all__ = ["BagTimeline", "is_bag", "open_bag", "parse_map"]
