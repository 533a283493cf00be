"""The estimator's topics and loop: frames in; odometry, vertices and localization out."""

from __future__ import annotations

import time
from collections.abc import Hashable
from dataclasses import replace
from typing import Generic, TypeVar

import numpy as np
import structlog

from common import messages as m
from common import topics
from common.geometry import Array, Uncertain
from common.ids import VertexId
from common.service import Service
from services.estimator import relocalization, repeats
from services.estimator.anchor import Anchor
from services.estimator.committer import Committer
from services.estimator.experience import Place
from services.estimator.experience_loader import ExperienceLoader
from services.estimator.joints import JointBehind, JointSearch
from services.estimator.merging import ClosureSearch
from services.estimator.pipeline import Localized, Pipeline, Step
from services.estimator.recording import Recording
from services.estimator.relocalization import Finder
from services.estimator.repeats import Repeats
from services.estimator.route_localizer import RouteLocalizer, single_vertex_path
from services.estimator.route_map import RouteMap
from services.estimator.sensors import Sensor, sensor_of
from services.estimator.sensors.sensor import FramePipeline, SensorFrame, TeachesActions
from services.estimator.settings import Settings
from services.estimator.submaps import SubmapCache
from services.estimator.wheels import WheelMotion

log = structlog.get_logger()

_FRAME_WAIT_S = 0.1
_ASK_S = 1.0

Frame = TypeVar("Frame", bound=SensorFrame)
Live = TypeVar("Live")
Submap = TypeVar("Submap")


def main(service: Service) -> None:
    """Estimates until the service stops."""
    settings = service.config.settings("estimator", Settings)
    Estimator(service, settings, sensor_of(service.config.robot.sensor, settings)).run()


class Estimator(Generic[Frame, Live, Submap]):
    """Takes frames one at a time and does with each what the navigator's state asks for."""

    def __init__(self, service: Service, settings: Settings, sensor: Sensor[Frame, Live, Submap]) -> None:
        bus = service.bus
        self._service = service
        self._settings = settings
        self._sensor = sensor
        self._frames = bus.subscribe(sensor.topic, sensor.name)
        self._wheels = bus.subscribe(topics.WHEEL_ODOMETRY)
        self._safe = bus.subscribe(topics.SAFE)
        self._states = bus.subscribe(topics.STATE)
        self._routes = bus.subscribe(topics.ROUTE)
        self._odometry = bus.publisher(topics.ODOMETRY)
        self._localization = bus.publisher(topics.LOCALIZATION)
        self._matches = bus.publisher(topics.MATCHES)
        self._closures = bus.publisher(topics.LOOP_CLOSURE)
        self._committer = Committer(lambda commit: bus.ask(topics.COMMIT, commit, _ASK_S), service.stop)
        self._submaps: SubmapCache[Submap] = SubmapCache(self._fetch, self._read)
        self._anchor = Anchor()
        self._recording: Recording[Live, Submap] = Recording(service, self._committer, self._submaps, self._anchor)
        self._experiences = ExperienceLoader(self._topology, settings.experiences)
        self._finder: Finder[Live, Submap] = Finder(
            bus.ask,
            sensor.appearance,
            service.config.robot.environment,
            sensor.topic.max_age_s,
            settings.relocalization,
        )
        self._wheel_motion = WheelMotion(settings.wheels)
        self._wheels_stamp: int | None = None
        self._repeats = Repeats(sensor.pictures)
        self._hangs = False
        self._calibration: Hashable = None
        self._pipeline: FramePipeline[Frame, Live, Submap] | None = None
        self._localizer: RouteLocalizer[Live, Submap] | None = None
        self._localizing: tuple[str, VertexId | None] | None = None
        self._joint: JointSearch[Live, Submap] | None = None
        self._behind: JointBehind | None = None
        self._closure: ClosureSearch[Live, Submap] | None = None
        self._last_step: Step[Live] | None = None
        self._last_success = time.monotonic()

    @property
    def busy(self) -> bool:
        """Whether a commit, a submap or a route's experiences are still under way beside the frames' path."""
        return self._committer.unanswered > 0 or self._submaps.missing or self._experiences.loading

    def run(self) -> None:
        """The loop: one frame after another, always the newest."""
        service = self._service
        self._sensor.warm_up()
        relocalization.warm_up()
        service.thread(self._committer.run, "commits")
        service.thread(lambda: self._submaps.run(service.stop), "submaps")
        service.thread(lambda: self._experiences.run(service.stop), "experiences")
        service.thread(lambda: self._finder.run(service.stop), "places")
        service.bus.serve(topics.RELOCALIZE, self._finder.answer)
        service.ready()
        while not service.stop.is_set():
            received = self._frames.wait(_FRAME_WAIT_S)
            state = self._states.last()
            if state is not None:
                self._recording.end(state.message, self._last_step)
            if received is not None:
                try:
                    with service.stage("frame"):
                        self._take(received.message, None if state is None else state.message)
                except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
                    log.warning("a frame cannot be used", reason=str(error))

    def _take(self, frame: Frame, state: m.State | None) -> None:
        """One frame through the stages that the state asks for."""
        pipeline = self._pipeline_of(frame)
        if isinstance(pipeline, TeachesActions):
            self._hand_command(pipeline, frame.stamp)
        step = self._step(pipeline, frame)
        for stage, milliseconds in step.milliseconds.items():
            self._service.record(stage, milliseconds / 1e3)
        self._anchor.move(step)
        if self._behind is not None:
            self._behind.move(step)
        self._publish_odometry(step)
        if state is not None:
            localized = self._localize(pipeline, step, state)
            self._recording.step(pipeline, step, state, localized)
            self._merge(pipeline, step, state)
        self._finder.see(step, idle=state is None or state.name == m.StateName.IDLE)
        self._last_step = step

    def _step(self, pipeline: FramePipeline[Frame, Live, Submap], frame: Frame) -> Step[Live]:
        """Preprocessing and odometry of a frame; what the sensor only repeats shows nothing."""
        wheels = self._wheels.fresh()
        hangs = self._repeats.repeats(frame, None if wheels is None else (wheels.v, wheels.w))
        if hangs != self._hangs:
            self._hangs = hangs
            log.warning(repeats.REASON if hangs else "the sensor shows something new again")
        driven = self._driven(frame.stamp, wheels)
        if not hangs:
            return pipeline.take(frame, driven)
        return replace(
            pipeline.take(repeats.without_sight(frame, self._sensor.pictures), driven), reason=repeats.REASON
        )

    def _driven(self, stamp: int, wheels: m.WheelOdometry | None) -> Uncertain | None:
        """The vehicle's motion since the last frame by its wheels, if they tell."""
        self._wheels_stamp = None if wheels is None else wheels.stamp
        seconds = 0.0 if self._last_step is None else (stamp - self._last_step.stamp) * 1e-9
        return self._wheel_motion.step(None if wheels is None else (wheels.v, wheels.w), seconds)

    def _hand_command(self, pipeline: TeachesActions, stamp: int) -> None:
        """Tells the pipeline what the base obeys now, and how long after the frame's stamp that is."""
        command = self._safe.fresh()
        if command is not None:
            late = (m.now_ns() - stamp) * 1e-9
            pipeline.obey(command.v, command.w, min(max(late, 0.0), self._sensor.topic.max_age_s))

    def _pipeline_of(self, frame: Frame) -> FramePipeline[Frame, Live, Submap]:
        """The pipeline of a frame's calibration; another calibration starts another one."""
        calibration = self._sensor.calibration(frame)
        if self._pipeline is None or calibration != self._calibration:
            if self._pipeline is not None:
                self._pipeline.close()
            self._pipeline = self._sensor.open(frame)
            self._calibration = calibration
            self._finder.searcher = self._sensor.searcher(frame)
            self._localizer, self._localizing, self._last_step = None, None, None
            self._anchor.forget()
        return self._pipeline

    # --- localization ------------------------------------------------------------------------------------------------

    def _localize(self, pipeline: Pipeline[Live, Submap], step: Step[Live], state: m.State) -> Place | None:
        """Keeps the chain, and localizes in the states that need it; where the frame is, if that was found."""
        names = m.StateName
        searching = state.name in (names.TEACH_METRIC_LOCALIZE, names.REPEAT_METRIC_LOCALIZE)
        if searching or state.name == names.REPEAT_FOLLOW:
            self._prepare(pipeline, state)
        elif state.name != names.PAUSED:
            self._localizer, self._localizing = None, None
        localizer = self._localizer
        if localizer is None:
            return None
        localizer.move(step)
        ahead = [] if self._joint is None else self._joint.wanted(localizer)
        self._submaps.want([*localizer.wanted(), *ahead])
        if state.name == names.PAUSED:
            return None
        with self._service.stage("localize"):
            result = localizer.follow(step) if self._is_following(state, localizer) else localizer.search(step)
        if result.success:
            self._last_success = time.monotonic()
            self._anchor.set(localizer.trunk_and_leaf())
            self._anchor.joined = self._anchor.vertex if state.name == names.TEACH_METRIC_LOCALIZE else None
            self._join(localizer, step)
        self._publish_localization(step, state, localizer, result)
        return localizer.branch_and_leaf() if result.success else None

    @staticmethod
    def _is_following(state: m.State, localizer: RouteLocalizer[Live, Submap]) -> bool:
        return state.name == m.StateName.REPEAT_FOLLOW and localizer.chain.localized

    def _prepare(self, pipeline: Pipeline[Live, Submap], state: m.State) -> None:
        """Has a localizer for what the state localizes against: a route, or a single vertex."""
        wish = (state.route, state.target)
        if self._localizer is not None and self._localizing == wish:
            return
        settings = self._settings
        if state.name == m.StateName.TEACH_METRIC_LOCALIZE:
            if state.target is None:
                return
            vertices, path = [state.target], single_vertex_path()
        else:
            route = self._routes.last()
            if route is None or route.message.id != state.route:
                return
            vertices, path = route.message.vertices, route.message.path
        if self._localizer is not None and self._goes_on(self._localizer, state, vertices, path):
            localizer = self._localizer
        else:
            self._leave(self._localizer, state)
            route_map: RouteMap[Live, Submap] = RouteMap(
                vertices, path, pipeline, self._submaps.get, settings.experiences
            )
            localizer = self._sensor.localizer(route_map, path, pipeline)
            self._experiences.load(state.environment, vertices, path, localizer.use)
        self._joint = self._joint_after(state, pipeline)
        if not localizer.chain.localized:
            localizer.start(state.position if state.name == m.StateName.REPEAT_FOLLOW else state.target)
            self._last_success = time.monotonic()
        self._localizer, self._localizing = localizer, wish

    def _goes_on(
        self, localizer: RouteLocalizer[Live, Submap], state: m.State, vertices: list[VertexId], path: Array
    ) -> bool:
        """Whether the localizer serves the new wish as well."""
        if self._localizing is not None and self._localizing[0] == state.route != "":
            # The same route with another target: a resume after a pause, during which the chain went on.
            return True
        if state.name != m.StateName.REPEAT_FOLLOW or not localizer.extend(vertices, path):
            return False
        self._experiences.load(state.environment, vertices, path, localizer.use)
        return True

    def _leave(self, localizer: RouteLocalizer[Live, Submap] | None, state: m.State) -> None:
        """Remembers the end of a route that is left for the next map of its plan."""
        self._behind = None
        if localizer is None or self._joint is None or state.target is None:
            return
        if localizer.metric and localizer.chain.localized and state.target.map_id == self._joint.next_map:
            last = localizer.map.vertices[-1]
            self._behind = JointBehind(last, localizer.T_end_leaf(), self._settings.joints)

    def _joint_after(self, state: m.State, pipeline: Pipeline[Live, Submap]) -> JointSearch[Live, Submap] | None:
        """A search for the map that comes after the route, if its plan goes on; the present one goes on as well."""
        received = self._routes.last()
        route = None if received is None else received.message
        if route is None or route.id != state.route or route.next_map is None:
            return None
        last = route.vertices[-1]
        if self._joint is not None and (self._joint.last, self._joint.next_map) == (last, route.next_map):
            return self._joint
        return JointSearch(last, route.next_map, pipeline, self._submaps.get, self._settings.joints)

    def _join(self, localizer: RouteLocalizer[Live, Submap], step: Step[Live]) -> None:
        """Commits the edge by which two maps of a plan are found to meet."""
        edge = None
        if self._behind is not None:
            edge = self._behind.edge(*localizer.trunk_and_leaf())
            self._behind = None
        elif self._joint is not None and localizer.metric:
            with self._service.stage("joint"):
                edge = self._joint.look(localizer, step)
        if edge is not None:
            log.info("two maps meet", a=str(edge.a), b=str(edge.b))
            self._committer.put(m.Commit(edges=[edge]))

    def _publish_localization(
        self, step: Step[Live], state: m.State, localizer: RouteLocalizer[Live, Submap], result: Localized
    ) -> None:
        chain = localizer.chain
        estimate = chain.T_trunk_leaf()
        self._localization.put(
            m.Localization(
                stamp=step.stamp,
                route=state.route if state.name != m.StateName.TEACH_METRIC_LOCALIZE else "",
                trunk=localizer.trunk,
                trunk_index=chain.trunk,
                T_trunk_robot=estimate.T,
                covariance=estimate.covariance,
                success=result.success,
                stream=result.stream,
                streams={name: found.success for name, found in result.streams.items()},
                inliers=result.inliers,
                metres_since_success=chain.metres_since_success,
                seconds_since_success=time.monotonic() - self._last_success,
                reason=result.reason,
                metric=localizer.metric,
                actions=localizer.actions(),
            )
        )

        if result.pixels is not None:
            pixels = result.pixels.astype(np.float32, copy=False)
            self._matches.put(m.Matches(stamp=step.stamp, stream=result.stream, success=result.success, pixels=pixels))

    def _publish_odometry(self, step: Step[Live]) -> None:
        estimate = self._anchor.T_vertex_live
        self._odometry.put(
            m.Odometry(
                stamp=step.stamp,
                vertex=self._anchor.vertex,
                T_vertex_robot=estimate.T,
                covariance=estimate.covariance,
                twist=step.twist,
                success=step.success,
                inliers=step.inliers,
                reason=step.reason,
                wheels=self._wheels_stamp,
            )
        )

    # --- merging -----------------------------------------------------------------------------------------------------

    def _merge(self, pipeline: Pipeline[Live, Submap], step: Step[Live], state: m.State) -> None:
        """Looks for a loop closure of the map that is being taught, until one is offered."""
        merging = state.name == m.StateName.TEACH_MERGE and state.candidates and state.closure is None
        last = self._recording.last
        if not merging or last is None or not step.success:
            self._closure = None
            return
        if self._closure is None or self._closure.candidates != tuple(state.candidates):
            settings = self._settings.closures
            self._closure = ClosureSearch(state.candidates, pipeline, self._submaps.get, settings)
        self._submaps.want(list(state.candidates))
        with self._service.stage("merge"):
            found = self._closure.look(last, step)
        if found is not None:
            self._closures.put(found)

    # --- submaps -----------------------------------------------------------------------------------------------------

    def _fetch(self, vertices: list[VertexId]) -> list[m.VertexRecord]:
        answer: m.Submap = self._service.bus.ask(topics.SUBMAP, m.GraphQuery(vertices=vertices), _ASK_S)
        return answer.vertices

    def _topology(self, environment: str) -> m.Topology:
        answer: m.Topology = self._service.bus.ask(topics.TOPOLOGY, m.GraphQuery(environment=environment), _ASK_S)
        return answer

    def _read(self, record: m.VertexRecord) -> Submap:
        if self._pipeline is None:
            raise ValueError(f"no frame has come yet on {self._sensor.topic.at('<robot>', self._sensor.name)}")
        return self._pipeline.read(record)
