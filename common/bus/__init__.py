"""The bus: one Zenoh session a process, on which the topics of ``common/topics.py`` travel.

* :class:`Bus` publishes, subscribes, serves and asks.
* :class:`Subscription` is the newest (or every) valid sample of a topic, with its age.
* :class:`Tap` is every sample of some topics, for those who write down rather than act.
* :class:`Presence` is who is there, and :class:`Robots` who of the whole fleet.
"""

from common.bus.presence import Presence, Robots
from common.bus.session import Bus, Publisher
from common.bus.subscription import Received, Subscription
from common.bus.tap import Sample, Tap

__all__ = ["Bus", "Presence", "Publisher", "Received", "Robots", "Sample", "Subscription", "Tap"]
