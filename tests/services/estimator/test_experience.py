"""Recording an experience makes an unbroken chain of vertices, whatever the odometry does."""

import numpy as np

from common import geometry
from common.geometry import Uncertain
from common.ids import VertexId, new_map_id
from common.messages import Keyframe, MapRecord
from services.estimator.experience import ExperienceRecorder
from services.estimator.pipeline import Step

OTHER = VertexId(new_map_id("r2", 1), 7)


class PlainPipeline:
    """A vertex each half metre; keyframes without content."""

    def keyframe(self, live):
        return Keyframe(pipeline="stereo", arrays={"place": np.array([float(live)])})

    def is_vertex_due(self, T_vertex_live, _inliers):
        return bool(np.linalg.norm(T_vertex_live[:3, 3]) >= 0.5)


def record():
    return MapRecord(id=new_map_id("r1", 10**18), environment="yard", stamp=10**18, robot="r1", sensor="stereo")


def step(metres, *, success=True, stamp=0):
    T = Uncertain(geometry.exp([metres, 0, 0, 0, 0, 0]), np.diag([1e-6] * 6))
    return Step(stamp, T, np.zeros(6), success, 100, "", float(stamp))


def drive(recorder, count, metres=0.1, **options):
    commits = [recorder.step(step(metres, stamp=i, **options)) for i in range(count)]
    return [commit for commit in commits if commit is not None]


def test_vertices_are_numbered_and_joined_by_what_was_driven():
    recorder = ExperienceRecorder(record(), PlainPipeline())
    commits = drive(recorder, 31)
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
    commits = drive(ExperienceRecorder(record(), PlainPipeline(), joined=(OTHER, T)), 1)
    (edge,) = commits[0].edges
    assert (edge.kind, edge.a) == ("spatial", OTHER)
    assert np.allclose(edge.T_a_b, T.T)


def test_no_vertex_is_made_of_a_frame_whose_motion_is_unknown():
    recorder = ExperienceRecorder(record(), PlainPipeline())
    assert drive(recorder, 5, success=False) == []
    drive(recorder, 1)
    assert drive(recorder, 20, success=False) == []
    (commit,) = drive(recorder, 1)
    assert np.isclose(commit.edges[0].T_a_b[0, 3], 2.1)


def test_the_end_is_a_vertex_unless_the_last_one_is_there():
    recorder = ExperienceRecorder(record(), PlainPipeline())
    drive(recorder, 4)
    last = recorder.finish(step(0.0))
    assert last.finished == recorder.record.id
    assert last.vertex.id.index == 1
    assert np.isclose(last.edges[0].T_a_b[0, 3], 0.3)
    standing = ExperienceRecorder(record(), PlainPipeline())
    drive(standing, 1)
    assert standing.finish(step(0.0)).vertex is None


def test_a_recording_is_taken_up_again_behind_its_last_vertex():
    map_record = record()
    last = VertexId(map_record.id, 12), Uncertain(geometry.exp([0.4, 0, 0, 0, 0, 0]), np.eye(6) * 1e-6)
    (commit,) = drive(ExperienceRecorder(map_record, PlainPipeline(), last=last), 1)
    assert commit.vertex.id.index == 13
    assert commit.map is None
    assert commit.edges[0].a.index == 12
