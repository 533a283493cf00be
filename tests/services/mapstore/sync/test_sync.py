"""Maps go up and come down, through a real storage, and what is wrong with it is said."""

from __future__ import annotations

import errno
import itertools
from dataclasses import replace

import numpy as np
import pytest

from common.environment.metadata import MapMetadata, archive_key, metadata_key, report_key
from common.messages import FetchRequest, MapReport, PushRequest, RepeatReport, SyncState
from common.objects import ObjectStore
from tests.services.mapstore.graphs import drive
from tests.services.mapstore.test_archive import contents
from tests.storage import Storage

NUMBERS = itertools.count(100)


def wait_synced(robot, map_id):
    robot.soon(lambda: robot.store.summary(map_id).sync is SyncState.SYNCED, "the map is shared")


def has(robot, map_id):
    return map_id in {summary.record.id for summary in robot.store.maps_of("yard")}


def test_one_robot_shares_and_another_fetches(robots, storage):
    number = next(NUMBERS)
    teacher, learner = robots("r1").start(), robots("r2").start()
    map_id = teacher.teach(drive(number, 5))
    wait_synced(teacher, map_id)
    teacher.soon(lambda: [one.map for one in teacher.told] == [map_id], "the server is told")
    assert not list(teacher.folder.glob(f"{map_id}*"))
    learner.syncer.want(FetchRequest(environment="yard", maps=[map_id]))
    learner.soon(lambda: has(learner, map_id), "the map is there")
    assert learner.store.summary(map_id).sync is SyncState.FETCHED
    assert contents(learner.store, number) == contents(teacher.store, number)
    assert learner.store.to_share("r2") == []
    metadata = MapMetadata.model_validate_json(storage.connect().get("environments", metadata_key("yard", map_id)))
    assert (metadata.start, metadata.end, metadata.vertices) == ("gate", "yard", 5)


def test_a_report_is_shared_once(robots, storage):
    robot = robots("r1").start()
    report = RepeatReport(id="20261126-1", robot="r1", environment="yard", stamp=1, maps=[
        MapReport(map=drive(1, 1)[0].map.id, metres=3.0, lost=1.0)
    ])  # fmt: skip
    robot.store.report(report)
    robot.store.report(report)
    robot.syncer.notice()
    robot.soon(lambda: robot.store.reports(9) == [], "the report is shared")
    stored = storage.connect().get("environments", report_key("r1", "yard", report.id))
    assert RepeatReport.model_validate_json(stored) == report


def test_a_storage_that_is_away_is_waited_for(robots, tmp_path):
    (tmp_path / "away").mkdir()
    with Storage(tmp_path / "away") as storage:
        storage.kill()
        robot = robots("r1", storage=storage).start()
        map_id = robot.teach(drive(next(NUMBERS), 3))
        robot.soon(lambda: "is it up?" in robot.syncer.status().reason, "the robot says why")
        assert not robot.syncer.status().online
        assert robot.store.summary(map_id).sync in {SyncState.WAITING, SyncState.UPLOADING}
        storage.start()
        wait_synced(robot, map_id)
        assert robot.syncer.status().online


def test_wrong_credentials_are_said(robots, storage, tmp_path):
    wrong = tmp_path / "wrong.json"
    wrong.write_text(storage.settings("r1").credentials.read_text().replace('"secret_key":"', '"secret_key":"x'))
    wrong.chmod(0o600)
    robot = robots("r1")
    robot.syncer._settings = replace(robot.syncer._settings, credentials=wrong)
    robot.start()
    map_id = robot.teach(drive(next(NUMBERS), 3))
    robot.soon(lambda: "are the credentials right?" in robot.syncer.status().reason, "the robot says why")
    wrong.chmod(0o644)
    robot.soon(lambda: "chmod 600" in robot.syncer.status().reason, "the robot says why")
    assert robot.store.summary(map_id).vertices == 3


def test_a_flipped_bit_in_the_storage_is_refused(robots, storage):
    teacher, learner = robots("r1").start(), robots("r2").start()
    map_id = teacher.teach(drive(next(NUMBERS), 4))
    wait_synced(teacher, map_id)
    server, key = storage.connect(), archive_key("yard", map_id)
    content = bytearray(server.get("maps", key))
    content[len(content) // 2] ^= 4
    server.put("maps", key, bytes(content))
    learner.syncer.want(FetchRequest(environment="yard", maps=[map_id]))
    learner.soon(
        lambda: learner.syncer.transfers.state_of(map_id, upload=False) is SyncState.QUARANTINED, "it is refused"
    )
    (transfer,) = [one for one in learner.syncer.status().transfers if one.map == map_id]
    assert "is spoilt in the fleet's storage" in transfer.reason
    assert not has(learner, map_id)
    assert not list(learner.folder.glob("*"))


@pytest.mark.parametrize(
    ("content", "words"), [(b"{}", "is wrong at"), (b"\x80\x04pickle", "is wrong at"), (None, "no object")]
)
def test_metadata_that_is_wrong_is_said(robots, storage, content, words):
    learner = robots("r2").start()
    map_id = drive(next(NUMBERS), 1)[0].map.id
    if content is not None:
        storage.connect().put("environments", metadata_key("yard", map_id), content)
    learner.syncer.want(FetchRequest(environment="yard", maps=[map_id]))
    learner.soon(
        lambda: learner.syncer.transfers.state_of(map_id, upload=False) is SyncState.QUARANTINED, "it is refused"
    )
    assert words in learner.syncer.status().transfers[-1].reason


def test_another_map_under_the_same_name_is_not_overwritten(robots, storage):
    robot = robots("r1")
    map_id = robot.teach(drive(next(NUMBERS), 3))
    key = metadata_key("yard", map_id)
    storage.connect().put("environments", key, b"something else")
    robot.start()
    robot.soon(lambda: robot.store.summary(map_id).sync is SyncState.QUARANTINED, "it is in quarantine")
    assert storage.connect().get("environments", key) == b"something else"
    storage.connect().put("environments", key, b"still something else")
    assert "1 of them out of quarantine" in robot.syncer.push(PushRequest())


def test_maps_that_are_safe_leave_for_others_and_no_other_does(robots):
    teacher = robots("r1").start()
    ids = [teacher.teach(drive(next(NUMBERS), 4, size=200_000)) for _ in range(3)]
    for map_id in ids:
        wait_synced(teacher, map_id)
    learner = robots("r2", quota_mb=2.5)
    own = drive(next(NUMBERS), 1, size=200_000)[0]
    learner.store.commit(own)
    learner.start()
    learner.syncer.want(FetchRequest(environment="yard", maps=ids[:2]))
    learner.soon(lambda: has(learner, ids[1]), "two are there")
    learner.syncer.use([ids[1]])
    learner.syncer.want(FetchRequest(environment="yard", maps=ids[2:]))
    learner.soon(lambda: has(learner, ids[2]), "the third is there")
    assert not has(learner, ids[0])
    assert has(learner, ids[1])
    assert has(learner, own.map.id)
    learner.syncer.want(FetchRequest(environment="yard", maps=[ids[0]]))
    learner.soon(
        lambda: learner.syncer.transfers.state_of(ids[0], upload=False) is SyncState.QUARANTINED, "there is no room"
    )
    assert "quota_mb" in learner.syncer.status().transfers[-1].reason


def test_a_full_disk_is_said_and_nothing_is_lost(robots, monkeypatch):
    teacher, learner = robots("r1").start(), robots("r2")
    map_id = teacher.teach(drive(next(NUMBERS), 4))
    wait_synced(teacher, map_id)

    def full(*_arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(ObjectStore, "download", full)
    learner.start()
    learner.syncer.want(FetchRequest(environment="yard", maps=[map_id]))
    learner.soon(lambda: "free some space" in learner.syncer.status().reason, "the robot says why")
    assert not has(learner, map_id)
    monkeypatch.undo()
    learner.soon(lambda: has(learner, map_id), "it is fetched once there is space")


def test_a_disk_that_is_nearly_full_takes_no_map(robots):
    teacher, learner = robots("r1").start(), robots("r2")
    map_id = teacher.teach(drive(next(NUMBERS), 4))
    wait_synced(teacher, map_id)
    learner.store._settings = replace(learner.store._settings, reserve_mb=1e9)
    learner.start()
    learner.syncer.want(FetchRequest(environment="yard", maps=[map_id]))
    learner.soon(lambda: "is nearly full" in learner.syncer.status().reason, "the robot says why")
    assert not has(learner, map_id)
    learner.store._settings = replace(learner.store._settings, reserve_mb=0)
    learner.soon(lambda: has(learner, map_id), "it is fetched once there is space")


def test_a_map_whose_metadata_cannot_be_made_goes_into_quarantine(robots):
    robot = robots("r1")
    commits = drive(next(NUMBERS), 3)
    rows = np.full((1, 4), 5000.0, dtype=np.float32)
    keyframe = commits[1].vertex.keyframe
    spoilt = keyframe.model_copy(update={"arrays": keyframe.arrays | {"actions": rows}})
    last = commits[2].vertex.keyframe
    commits[1] = commits[1].model_copy(update={"vertex": commits[1].vertex.model_copy(update={"keyframe": spoilt})})
    also = last.model_copy(update={"arrays": last.arrays | {"actions": rows}})
    commits[2] = commits[2].model_copy(update={"vertex": commits[2].vertex.model_copy(update={"keyframe": also})})
    map_id = robot.teach(commits)
    robot.start()
    robot.soon(lambda: robot.store.summary(map_id).sync is SyncState.QUARANTINED, "it is in quarantine")
    other = robot.teach(drive(next(NUMBERS), 3))
    wait_synced(robot, other)


def test_a_store_that_cannot_be_read_is_said(robots):
    robot = robots("r1")
    robot.store.close()
    assert "closing" in robot.syncer.status().reason
