"""The metadata of a map (section 3.1.1 of the thesis), made of what the store holds of it."""

from __future__ import annotations

import cv2
import numpy as np
import structlog
from numpy.typing import NDArray

from common import geometry
from common.environment.metadata import Archive, ImageAlong, MapMetadata, time_of
from common.errors import ImageError
from common.geometry import Array
from common.ids import VertexId
from common.messages import Keyframe
from common.registration import OF_THUMBNAILS, GradientRepresentation
from services.mapstore.store import Store

ALONG = 4
"""Images of a map that stand for it."""

_ACTIONS = "actions"
_ACTION_COLUMNS = 4
_NS = 1e-9

_SAME = 0.01
"""Of m/s and rad/s: what differs by less is the same command."""

log = structlog.get_logger()

Actions = list[tuple[float, float, float, float]]


def metadata_of(store: Store, map_id: str, archive: Archive) -> MapMetadata:
    """The metadata of a finished map that is stored in an archive.

    Raises:
        GraphError: the map is unknown, or its last keyframe is damaged.
        StoreError: the store cannot be read.
    """
    summary = store.summary(map_id)
    stamps, steps = store.track(map_id)
    times = (stamps - stamps[0]) * _NS
    times = np.maximum.accumulate(np.maximum(times, 0.0))
    distances = np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps[:, :3, 3], axis=1))])
    recorded = _recorded_actions(store, map_id, times, distances)
    record = summary.record
    return MapMetadata(
        name=record.id,
        environment=record.environment,
        robot=record.robot,
        sensor=record.sensor,
        timestamp=time_of(record.stamp),
        length=summary.length,
        start=summary.start_place,
        end=summary.end_place,
        generation=record.generation,
        parent=record.parent,
        vertices=summary.vertices,
        times=np.round(times, 3).tolist(),
        distances=np.round(distances, 3).tolist(),
        actions=held(recorded or driven_actions(times, distances, steps)),
        images=_images(store, map_id, distances),
        archive=archive,
    )


def driven_actions(times: Array, distances: Array, steps: Array) -> Actions:
    """What a map's robot did, as rows (s, m, m/s, rad/s): of a map whose commands nobody recorded.

    ``steps`` (N - 1, 4, 4) lead from each vertex to the next; driving backwards has a negative speed.
    """
    seconds = np.maximum(np.diff(times), 1e-3)
    lengths = np.diff(distances) * np.where(steps[:, 0, 3] < 0.0, -1.0, 1.0)
    turns = geometry.yaw_of(steps) if len(steps) else np.empty(0)
    rates = np.clip(np.column_stack([lengths / seconds, turns / seconds]), -1000.0, 1000.0)
    rows = np.column_stack([times[:-1], distances[:-1], rates])
    return [(float(t), float(d), float(v), float(w)) for t, d, v, w in np.round(rows, 3)]


def held(actions: Actions) -> Actions:
    """The actions without those that only go on as the one before: what is commanded holds until it changes."""
    kept: Actions = []
    for action in actions:
        if not kept or max(abs(action[2] - kept[-1][2]), abs(action[3] - kept[-1][3])) >= _SAME:
            kept.append(action)
    return kept


def _recorded_actions(store: Store, map_id: str, times: Array, distances: Array) -> Actions:
    """The commands that a bearing map's keyframes hold: metres and seconds since the vertex before, m/s, rad/s."""
    rows: Actions = []
    for index in range(1, len(times)):
        found = _keyframe(store, map_id, index).arrays.get(_ACTIONS)
        if found is None or found.ndim != 2 or found.shape[1] != _ACTION_COLUMNS:
            return []
        shifted = np.add(found, (distances[index - 1], times[index - 1], 0.0, 0.0))
        rows += [(float(s), float(m), float(v), float(w)) for m, s, v, w in np.round(shifted, 3)]
    return rows


def _images(store: Store, map_id: str, distances: Array) -> list[ImageAlong]:
    """Representations of a few pictures, evenly along the map; what cannot be represented is left out, and logged."""
    representation = GradientRepresentation(OF_THUMBNAILS)
    images = []
    for index in sorted({round(k) for k in np.linspace(0, len(distances) - 1, min(len(distances), ALONG))}):
        try:
            picture = _decoded(_keyframe(store, map_id, index).thumbnail)
            images.append(ImageAlong.of(round(float(distances[index]), 3), representation.describe(picture)))
        except ImageError as error:
            log.warning("a picture of a map cannot be represented", map=map_id, vertex=index, reason=str(error))
    return images


def _keyframe(store: Store, map_id: str, index: int) -> Keyframe:
    return store.whole_vertex(VertexId(map_id, index)).keyframe


def _decoded(thumbnail: bytes) -> NDArray[np.uint8]:
    content = np.frombuffer(thumbnail, dtype=np.uint8)
    image = cv2.imdecode(content, cv2.IMREAD_GRAYSCALE) if len(content) else None
    if image is None:
        raise ImageError("it is no picture")
    return np.asarray(image, dtype=np.uint8)
