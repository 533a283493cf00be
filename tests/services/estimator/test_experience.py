"""Recording an experience makes an unbroken chain of vertices, whatever the odometry does."""

import numpy as np

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId, new_map_id
from common.messages import Keyframe, MapRecord
from services.estimator.experience import ExperienceRecorder
from tests.services.estimator.driving import Drive

OTHER = VertexId(new_map_id("r2", 1), 7)


class PlainPipeline:
    """A vertex each half metre; keyframes without content."""

    def keyframe(self, live):
        return Keyframe(pipeline="stereo", arrays={"place": np.array([float(live)])})

    def is_vertex_due(self, T_vertex_live, _inliers):
        return bool(np.linalg.norm(T_vertex_live[:3, 3]) >= 0.5)


def record():
    return MapRecord(id=new_map_id("r1", 10**18), environment="yard", stamp=10**18, robot="r1", sensor="stereo")


def forward(metres):
    return [metres, 0, 0, 0, 0, 0]


def drive(recorder, motion, count, metres=0.1, *, localized=None, success=True):
    commits = [
        recorder.step(motion.on(forward(metres), success=success, live=motion.frames), localized) for _ in range(count)
    ]
    return [commit for commit in commits if commit is not None]


def test_vertices_are_numbered_and_joined_by_what_was_driven():
    recorder = ExperienceRecorder(record(), PlainPipeline())
    commits = drive(recorder, Drive(), 31)
    assert [c.vertex.id.index for c in commits] == list(range(7))
    assert commits[0].map == recorder.record
    assert commits[0].edges == []
    for commit in commits[1:]:
        (edge,) = commit.edges
        assert edge.kind == "temporal"
        assert edge.b == commit.vertex.id
        assert edge.a == VertexId(recorder.record.id, commit.vertex.id.index - 1)
        assert np.isclose(edge.T_a_b[0, 3], 0.5)
        assert np.allclose(np.diag(edge.covariance)[3:], 5e-6)


def test_the_first_vertex_hangs_on_the_vertex_it_was_localized_against():
    T = Uncertain(geometry.exp([0.2, 0.1, 0, 0, 0, 0.3]), np.eye(6) * 1e-4)
    commits = drive(ExperienceRecorder(record(), PlainPipeline(), joined=(OTHER, T)), Drive(), 1)
    (edge,) = commits[0].edges
    assert (edge.kind, edge.a) == ("spatial", OTHER)
    assert np.allclose(edge.T_a_b, T.T)


def test_no_vertex_is_made_of_a_frame_whose_motion_is_unknown():
    recorder, motion = ExperienceRecorder(record(), PlainPipeline()), Drive()
    assert drive(recorder, motion, 5, success=False) == []
    drive(recorder, motion, 1)
    assert drive(recorder, motion, 20, success=False) == []
    (commit,) = drive(recorder, motion, 1)
    assert np.isclose(commit.edges[0].T_a_b[0, 3], 2.1)


def test_the_end_is_a_vertex_unless_the_last_one_is_there():
    recorder, motion = ExperienceRecorder(record(), PlainPipeline()), Drive()
    drive(recorder, motion, 4)
    last = recorder.finish(motion.on(forward(0.0), live=4))
    assert last.finished == recorder.record.id
    assert last.vertex.id.index == 1
    assert np.isclose(last.edges[0].T_a_b[0, 3], 0.3)
    standing = ExperienceRecorder(record(), PlainPipeline())
    drive(standing, motion, 1)
    assert standing.finish(motion.on(forward(0.0), live=6)).vertex is None


def test_a_recording_is_taken_up_again_behind_its_last_vertex():
    map_record = record()
    last = VertexId(map_record.id, 12), Uncertain(geometry.exp([0.4, 0, 0, 0, 0, 0]), np.eye(6) * 1e-6)
    recorder, motion = ExperienceRecorder(map_record, PlainPipeline(), last=last), Drive()
    # The frame by which the place was found, and one a little on.
    assert drive(recorder, motion, 1) == []
    (commit,) = drive(recorder, motion, 1)
    assert commit.vertex.id.index == 13
    assert commit.map is None
    assert commit.edges[0].a.index == 12
    assert np.isclose(commit.edges[0].T_a_b[0, 3], 0.5)


def test_a_localized_frame_joins_its_vertex_to_the_other_map():
    T = Uncertain(geometry.exp([0.02, 0.1, 0, 0, 0, 0.03]), np.eye(6) * 1e-4)
    recorder, motion = ExperienceRecorder(record(), PlainPipeline()), Drive()
    drive(recorder, motion, 1, localized=(OTHER, T))
    drive(recorder, motion, 4)
    (commit,) = drive(recorder, motion, 1, localized=(OTHER, T))
    assert [edge.kind for edge in commit.edges] == ["temporal", "spatial"]
    assert (commit.edges[1].a, commit.edges[1].b) == (OTHER, commit.vertex.id)
    assert np.allclose(commit.edges[1].T_a_b, T.T)


def test_what_is_driven_between_recorded_frames_counts():
    recorder, motion = ExperienceRecorder(record(), PlainPipeline()), Drive(keyframe_every=3)
    drive(recorder, motion, 1)
    for _ in range(7):
        recorder.move(motion.on(forward(0.1)))
    (commit,) = drive(recorder, motion, 1)
    assert np.isclose(commit.edges[0].T_a_b[0, 3], 0.8)
