"""A robot's bus in MCAP files: our own messages complete, and beside them what Foxglove's viewers show.

* ``encoding``: a message of ours as JSON or msgpack, with its schema, and back.
* ``views``: Foxglove's well-known messages of ours.
* ``writer``: files that are whole after every flush, split by size.
* ``reader``: such files, as a drive.
"""

from services.sensors.recordings.mcap.reader import McapTimeline, is_mcap_recording, open_mcap
from services.sensors.recordings.mcap.writer import McapWriter

__all__ = ["McapTimeline", "McapWriter", "is_mcap_recording", "open_mcap"]
