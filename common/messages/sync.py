"""Between a robot's map store and the fleet's storage."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from common.messages.base import Count, MapId, Message, Name, NotNegative, Stamp, Text
from common.messages.graph import SyncState

Bytes = Annotated[int, Field(ge=0, lt=2**53)]


class FetchRequest(Message):
    """Asks for maps that other robots have shared; answered at once, and done in the background."""

    environment: Name
    maps: Annotated[list[MapId], Field(max_length=1000)]


class PushRequest(Message):
    """Asks to share finished maps now (none named: all), those in quarantine and those never sealed as well."""

    maps: Annotated[list[MapId], Field(max_length=1000)] = []


class Transfer(Message):
    """One map on its way: ``done`` of ``total`` bytes, how often it was tried, and why it waits or failed."""

    map: MapId
    environment: Name
    state: SyncState
    upload: bool
    done: Bytes = 0
    total: Bytes = 0
    attempts: Count = 0
    reason: Text = ""


class SyncStatus(Message):
    """What the map store shares and fetches now; on every change, and at least once a second while it does.

    ``online`` is False where the storage cannot be reached or none is configured, with the reason; ``retry_s`` is when
    it will be tried again. ``stored`` bytes of maps are on the disk, of which ``quota`` are allowed (0: no limit).
    """

    stamp: Stamp
    online: bool
    reason: Text = ""
    retry_s: NotNegative = 0.0
    transfers: Annotated[list[Transfer], Field(max_length=1000)] = []
    waiting: Count = 0
    synced: Count = 0
    stored: Bytes = 0
    quota: Bytes = 0


class Span(Message):
    """A stretch of a map, metres from its start."""

    start: NotNegative
    end: NotNegative


class MapReport(Message):
    """How a repeat went on one map: metres driven on it and how many of them without localization, and where.

    ``frames`` came while it was followed, ``slow`` of them took longer than their period; ``metres`` and ``lost`` may
    end early, where the robot gave up (``finished`` is False).
    """

    map: MapId
    metres: NotNegative
    lost: NotNegative
    spans: Annotated[list[Span], Field(max_length=1000)] = []
    frames: Count = 0
    slow: Count = 0
    finished: bool = True


class RepeatReport(Message):
    """What a repeat tells the fleet about the maps that it followed; ``stamp`` is when it began."""

    id: Name
    robot: Name
    environment: Name
    stamp: Stamp
    maps: Annotated[list[MapReport], Field(max_length=1000)]
