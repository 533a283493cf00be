"""What the estimator's loop asks of a sensor: its topic, and a pipeline for its frames."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any, Protocol, Self, TypeVar, runtime_checkable

from common.geometry import Array, Uncertain
from common.topics import Topic
from services.estimator.pipeline import Pipeline, Step
from services.estimator.relocalization.appearance import Appearance
from services.estimator.route_localizer import RouteLocalizer
from services.estimator.route_map import RouteMap


class SensorFrame(Protocol):
    """A message of a sensor: its stamp is the time at which a pose is told, nanoseconds."""

    @property
    def stamp(self) -> int: ...  # noqa: D102 - said above

    def model_copy(self, *, update: Mapping[str, Any]) -> Self: ...  # noqa: D102 - pydantic's


Frame_contra = TypeVar("Frame_contra", bound=SensorFrame, contravariant=True)
Live = TypeVar("Live")
Submap = TypeVar("Submap")


class FramePipeline(Pipeline[Live, Submap], Protocol[Frame_contra, Live, Submap]):
    """A pipeline that takes the frames of one calibration as they come from the bus."""

    def take(self, frame: Frame_contra, prior: Uncertain | None) -> Step[Live]:
        """Preprocessing and odometry; ``prior`` is the vehicle's motion since the last frame, if known.

        Raises:
            ValueError: the frame cannot be used.
        """
        ...

    def close(self) -> None:
        """Ends its threads."""
        ...


@runtime_checkable
class TeachesActions(Protocol):
    """A pipeline that keeps what the robot was commanded while it was taught."""

    def obey(self, v: float, w: float, later: float) -> None:
        """Takes the command (m/s, rad/s) that the base obeys ``later`` seconds after the next frame was taken."""
        ...


class Sensor(Protocol[Frame_contra, Live, Submap]):
    """One kind of sensor.

    Attributes:
        topic: of its frames.
        pictures: the fields of a frame that hold what the sensor sees.
        name: of the one sensor whose frames are taken.
    """

    topic: Topic
    pictures: tuple[str, ...]
    name: str

    def warm_up(self) -> None:
        """Compiles what a frame goes through: at start it delays nobody."""
        ...

    def calibration(self, frame: Frame_contra) -> Hashable:
        """What of a frame decides on its pipeline: one that is not equal needs another pipeline."""
        ...

    def open(self, frame: Frame_contra) -> FramePipeline[Frame_contra, Live, Submap]:
        """A pipeline for frames like this one, with threads of its own; ValueError where they cannot be used."""
        ...

    def searcher(self, frame: Frame_contra) -> Pipeline[Live, Submap]:
        """One beside it, without threads: a search must not wait for a frame, nor a frame for it."""
        ...

    def localizer(
        self, route_map: RouteMap[Live, Submap], path: Array, pipeline: Pipeline[Live, Submap]
    ) -> RouteLocalizer[Live, Submap]:
        """What keeps the robot located on a route with poses ``path`` (N, 4, 4)."""
        ...

    def appearance(self, live: Live) -> Appearance:
        """What a frame looks like, to be recognised among all vertices."""
        ...
