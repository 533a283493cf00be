"""Which topic of a bag becomes which of ours.

A mapping is written ``/bags/topic=key``. The key is ours below the robot's, for a part of a message with what it is:

* ``sensor/stereo/NAME.left``, ``.right``: images; ``.left.info``, ``.right.info``: their camera infos, where these do
  not stand beside the images as ``camera_info``;
* ``sensor/camera/NAME``, ``sensor/lidar/NAME``, ``sensor/odometry``;
* ``sensor/joystick.N``: a joystick whose button N is the dead man's switch. Without N the switch is never held.

A name of several topics, as ``/camera/left`` of ``/camera/left/image_raw``, stands for the image below it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from common import topics
from common.topics import Topic
from services.sensors.recordings.images import RecordingError
from services.sensors.recordings.timeline import SENSORS

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
CLOUD = "sensor_msgs/msg/PointCloud2"
ODOMETRY = "nav_msgs/msg/Odometry"
JOY = "sensor_msgs/msg/Joy"

_TYPES: dict[Topic, tuple[str, ...]] = {
    topics.STEREO: IMAGES,
    topics.CAMERA: IMAGES,
    topics.LIDAR: (CLOUD,),
    topics.WHEEL_ODOMETRY: (ODOMETRY,),
    topics.JOYSTICK: (JOY,),
}
_KEY = re.compile(r"(?P<key>[a-z0-9_/-]+)(?:\.(?P<part>left\.info|right\.info|left|right|\d{1,2}))?")
_PREFERRED = ("image_rect", "image_rect_color", "image_raw", "image")
"""Of several images below a name: the rectified one saves work."""

Types = Mapping[str, str]
"""The type of each of a bag's topics."""


@dataclass(frozen=True, slots=True)
class Wish:
    """One mapping as it was written: the bag's topic, ours, the sensor's name, and the part of the message."""

    source: str
    topic: Topic
    name: str
    part: str = ""


@dataclass(frozen=True, slots=True)
class StereoSource:
    """The bag's topics that make up a stereo camera."""

    left: str
    right: str
    left_info: str
    right_info: str


@dataclass(frozen=True, slots=True)
class Plan:
    """What is played: by sensor's name the bag's topics, and the topics of wheels and joystick with its button."""

    stereo: dict[str, StereoSource] = field(default_factory=dict)
    cameras: dict[str, str] = field(default_factory=dict)
    lidars: dict[str, str] = field(default_factory=dict)
    odometry: str | None = None
    joystick: str | None = None
    button: int | None = None

    @property
    def sources(self) -> dict[str, str]:
        """Our key by the bag's topic, for every topic that is played."""
        found: dict[str, str] = {}
        for name, stereo in self.stereo.items():
            found |= dict.fromkeys((stereo.left, stereo.right), topics.STEREO.key.format(name=name))
        found |= {source: topics.CAMERA.key.format(name=name) for name, source in self.cameras.items()}
        found |= {source: topics.LIDAR.key.format(name=name) for name, source in self.lidars.items()}
        if self.odometry is not None:
            found[self.odometry] = topics.WHEEL_ODOMETRY.key
        if self.joystick is not None:
            found[self.joystick] = topics.JOYSTICK.key
        return found


def parse_map(texts: Iterable[str]) -> list[Wish]:
    """The mappings that are written in texts.

    Raises:
        RecordingError: one is not of the form, or names no topic that a recording is played on.
    """
    return [_parse(text) for text in texts]


def _parse(text: str) -> Wish:
    source, equals, target = text.partition("=")
    match = _KEY.fullmatch(target)
    found = None if match is None else topics.find(match["key"])
    if not equals or not source or match is None or found is None or found[0] not in SENSORS:
        known = ", ".join(topic.key.format(name="NAME") for topic in SENSORS)
        raise RecordingError(f"'{text}' maps nothing: write /bags/topic=KEY, with KEY one of {known}")
    topic, name = found
    part = match["part"] or ""
    if topic is topics.STEREO and (not part or part.isdecimal()):
        raise RecordingError(f"'{text}': which image of the pair is it? write {match['key']}.left or .right")
    if topic is not topics.STEREO and part and not (topic is topics.JOYSTICK and part.isdecimal()):
        raise RecordingError(f"'{text}': '{match['key']}' has no '.{part}'")
    return Wish("/" + source.strip("/"), topic, name, part)


def make_plan(types: Types, wishes: list[Wish], camera: str, lidar: str) -> Plan:
    """The plan that was wished for, or where nothing was, the one that the bag's types and names suggest.

    ``camera`` and ``lidar`` are the names of the sensors that the bag's become.

    Raises:
        RecordingError: a topic is not in the bag or of a wrong type, or a pair is not complete, or nothing fits.
    """
    if not wishes:
        return _suggested(types, camera, lidar)
    plan, halves = Plan(), dict[str, dict[str, str]]()
    for wish in wishes:
        source = _resolve(types, wish)
        if wish.topic is topics.STEREO:
            halves.setdefault(wish.name, {})[wish.part] = source
        elif wish.topic is topics.CAMERA:
            plan.cameras[wish.name] = source
        elif wish.topic is topics.LIDAR:
            plan.lidars[wish.name] = source
        elif wish.topic is topics.WHEEL_ODOMETRY:
            plan = replace(plan, odometry=source)
        else:
            plan = replace(plan, joystick=source, button=int(wish.part) if wish.part else None)
    for name, parts in halves.items():
        plan.stereo[name] = _pair(types, name, parts)
    return plan


def _resolve(types: Types, wish: Wish) -> str:
    """The bag's topic that a wish means."""
    wanted = (CAMERA_INFO,) if wish.part.endswith("info") else _TYPES[wish.topic]
    below = sorted(t for t in types if t.startswith(f"{wish.source}/") and types[t] in wanted)
    if wish.source in types:
        if types[wish.source] not in wanted:
            raise RecordingError(
                f"'{wish.source}' is a {types[wish.source]}: a {' or '.join(wanted)} becomes {wish.topic.key}"
            )
        return wish.source
    preferred = [t for base in _PREFERRED for t in below if _base(t).rpartition("/")[2] == base]
    if not below:
        raise RecordingError(f"the bag has no topic '{wish.source}': it has {listing(types)}")
    return (preferred or below)[0]


def _pair(types: Types, name: str, parts: dict[str, str]) -> StereoSource:
    for side in ("left", "right"):
        if side not in parts:
            raise RecordingError(
                f"the {side} image of camera '{name}' is missing: map it to sensor/stereo/{name}.{side}"
            )
    infos = [parts.get(f"{side}.info") or _info_of(types, parts[side], f"{name}.{side}") for side in ("left", "right")]
    return StereoSource(parts["left"], parts["right"], *infos)


def _info_of(types: Types, image: str, target: str) -> str:
    """The camera info beside an image, as ROS's image transport has it."""
    info = f"{_base(image).rpartition('/')[0]}/camera_info"
    if types.get(info) != CAMERA_INFO:
        raise RecordingError(
            f"'{image}' has no camera info: there is no {info}; map another one to sensor/stereo/{target}.info"
        )
    return info


def _base(image: str) -> str:
    """An image topic without its transport."""
    return image.removesuffix("/compressed")


def _suggested(types: Types, camera: str, lidar: str) -> Plan:
    """One stereo pair by the words left and right, one lidar, one odometry; never a joystick, which starts a robot."""
    plan = Plan()
    pairs = _pairs(types)
    clouds, wheels = ([t for t, kind in sorted(types.items()) if kind == wanted] for wanted in (CLOUD, ODOMETRY))
    for found, what in ((pairs, "stereo pairs"), (clouds, "point clouds"), (wheels, "odometries")):
        if len(found) > 1:
            raise RecordingError(f"the bag has several {what} ({listing(types)}): choose by --map /bags/topic=KEY")
    if pairs:
        left, right = pairs[0]
        plan.stereo[camera] = _pair(types, camera, {"left": left, "right": right})
    if clouds:
        plan.lidars[lidar] = clouds[0]
    if wheels:
        plan = replace(plan, odometry=wheels[0])
    if not plan.sources:
        raise RecordingError(f"nothing in the bag can be played by itself ({listing(types)}): choose by --map")
    return plan


def _pairs(types: Types) -> list[tuple[str, str]]:
    """Pairs of image topics that differ by left and right alone, the best image of each camera."""
    images = {t for t, kind in types.items() if kind in IMAGES}
    found: dict[str, tuple[str, str]] = {}
    for left in sorted(images, key=_rank, reverse=True):
        right = left.replace("left", "right")
        if right != left and right in images:
            found[_base(left).rpartition("/")[0]] = left, right
    return sorted(found.values())


def _rank(image: str) -> int:
    base = _base(image).rpartition("/")[2]
    return 2 * (_PREFERRED.index(base) if base in _PREFERRED else len(_PREFERRED)) + (base != image)


def listing(types: Types) -> str:
    """A bag's topics and their types, in words."""
    known = {kind for kinds in _TYPES.values() for kind in kinds} | {CAMERA_INFO}
    shown = [f"{topic} ({kind.rpartition('/')[2]})" for topic, kind in sorted(types.items()) if kind in known]
    return ", ".join(shown) or "no topic of a sensor"
