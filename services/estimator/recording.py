"""The map that is being recorded: begun, taken up again after a restart, and ended, as the navigator's state says."""

from __future__ import annotations

from typing import Generic, TypeVar

import structlog

from common import messages as m
from common import topics
from common.errors import BusError
from common.ids import VertexId
from common.service import Service
from services.estimator.anchor import Anchor
from services.estimator.committer import Committer
from services.estimator.experience import ExperienceRecorder, Place
from services.estimator.pipeline import Pipeline, Step
from services.estimator.submaps import SubmapCache

log = structlog.get_logger()

_ASK_S = 1.0

Live = TypeVar("Live")
Submap = TypeVar("Submap")


class Recording(Generic[Live, Submap]):
    """Commits the vertices of the map that is taught, or of the experience that is recorded in a repeat."""

    def __init__(self, service: Service, committer: Committer, submaps: SubmapCache[Submap], anchor: Anchor) -> None:
        self._service = service
        self._committer = committer
        self._submaps = submaps
        self._anchor = anchor
        self._recorder: ExperienceRecorder[Live, Submap] | None = None

    @property
    def last(self) -> Place | None:
        """The newest vertex, and the live frame in it; None where nothing is recorded."""
        return None if self._recorder is None else self._recorder.last

    def step(self, pipeline: Pipeline[Live, Submap], step: Step[Live], state: m.State, localized: Place | None) -> None:
        """Takes a frame; ``localized`` is where it is on the branch that is followed, if that was found."""
        teaching = state.name in (m.StateName.TEACH_BRANCH, m.StateName.TEACH_MERGE)
        following = state.name == m.StateName.REPEAT_FOLLOW
        if state.map is None or not (teaching or following):
            if self._recorder is not None:
                self._recorder.move(step)
            return
        if self._recorder is None:
            self._recorder = self._recorder_for(pipeline, step, state.map)
            if self._recorder is None or (following and localized is None):
                return
        with self._service.stage("vertex"):
            commit = self._recorder.step(step, localized)
        if teaching:
            self._anchor.set(self._recorder.last)
        if commit is not None:
            self._committer.put(commit)
            if commit.vertex is not None:
                self._submaps.put(commit.vertex.id, pipeline.read(commit.vertex))

    def end(self, state: m.State, last_step: Step[Live] | None) -> None:
        """Ends the recorded map once the navigator's state no longer holds it."""
        recorder = self._recorder
        if recorder is None or (state.map is not None and state.map.id == recorder.record.id):
            return
        self._recorder = None
        if recorder.last is None:
            return
        commit = recorder.finish(last_step)
        self._committer.put(commit)
        if commit.vertex is not None and recorder.record.generation == 0:
            self._anchor.set(recorder.last)

    def _recorder_for(
        self, pipeline: Pipeline[Live, Submap], step: Step[Live], record: m.MapRecord
    ) -> ExperienceRecorder[Live, Submap] | None:
        """A recorder for a new map, or for one that this process began in an earlier life; None while that is open."""
        try:
            stored: m.MapList = self._service.bus.ask(topics.MAPS, m.GraphQuery(environment=record.environment), _ASK_S)
        except BusError:
            return None
        vertices = next((found.vertices for found in stored.maps if found.record.id == record.id), 0)
        if vertices == 0:
            return ExperienceRecorder(record, pipeline, joined=self._anchor.joint())
        last = VertexId(record.id, vertices - 1)
        self._submaps.want([last])
        submap = self._submaps.get(last)
        if submap is None:
            return None
        result = pipeline.search(submap, step.live)
        if not result.success:
            return None
        log.info("a recording is taken up again", map=record.id, vertex=last.index)
        return ExperienceRecorder(record, pipeline, last=(last, result.T_vertex_live))
