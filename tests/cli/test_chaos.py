"""What the fault tests do and how they judge, without a robot."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from cli.chaos import orders
from cli.chaos.faults import Fault, Must, all_faults
from cli.chaos.injection import Injector
from cli.chaos.judge import Track, judge, unfinished
from cli.chaos.orders import Order
from cli.chaos.report import one, read, summary
from cli.chaos.series import cases, in_turn
from cli.errors import CommandError
from cli.processes import ROBOT
from common.camera import StereoCamera
from common.messages import CameraModel, StereoFrame, VelocityCommand
from tests.processes import eventually

STOP = Fault("kill tracker", "tracker", "kill", 2.0, Must.STOP, 0.25)
GO = Fault("kill planner", "planner", "kill", 2.0, Must.GO)


@pytest.mark.parametrize("doing", ["teach", "repeat"])
def test_every_process_is_killed_stopped_and_hung(doing):
    faults = all_faults(doing)
    assert len({fault.name for fault in faults}) == len(faults)
    for process in {process.name for process in ROBOT} - {"sensors", "router"}:
        assert {fault.how for fault in faults if fault.victim == process} >= {"kill", "stop", "hold", "clock"}


def test_a_repeat_needs_its_tracker_and_not_its_planner():
    by_name = {fault.name: fault for fault in all_faults("repeat")}
    assert (by_name["kill tracker"].must, by_name["kill tracker"].silence_s) == (Must.STOP, 0.25)
    assert by_name["kill planner"].must is Must.GO


def track(stops_at, *, moves_at=np.inf, offset=0.0):
    times = np.arange(0.0, 4.0, 0.01)
    speed = np.where((times >= stops_at) & (times < moves_at), 0.0, 1.0)
    commanded = np.where(times < moves_at, np.clip((stops_at - 0.05 - times) / 0.2, 0.0, 1.0), 1.0)
    return Track(times, speed, times, commanded, offset)


@pytest.mark.parametrize(
    ("fault", "seen", "words"),
    [
        (STOP, track(0.4), ""),
        (STOP, track(0.9), "stood after 0.90 s, and may take 0.65 s"),
        (STOP, track(0.63), "began to stop after 0.38 s, and may take 0.30 s"),
        (STOP, track(9.0), "stood after nan s"),
        (STOP, track(0.4, moves_at=1.0), "of the rest of the fault"),
        (STOP, track(0.4, offset=0.6), "0.60 m off its path"),
        (GO, track(9.0), ""),
        (GO, track(1.0), "stopped, and need not have"),
    ],
)
def test_a_robot_is_judged_by_its_wheels_and_its_place(fault, seen, words):
    outcome = judge(fault, "repeat", seen, 2.0, 0.35, resumed=False)
    assert outcome.passed == (not words)
    assert words in outcome.why


def test_a_stop_begins_where_the_command_starts_to_fall():
    times = np.arange(0.0, 2.0, 0.02)
    safe = np.clip(1.0 - 4.0 * (times - 0.3), 0.0, 1.0) - 0.001 * times
    outcome = judge(
        STOP, "repeat", Track(times, np.maximum(safe, 0), times, np.maximum(safe, 0), 0.0), 2.0, 0.35, resumed=False
    )
    assert outcome.stops_s == pytest.approx(0.3, abs=0.021)
    assert outcome.zero_command_s == pytest.approx(0.55, abs=0.021)


def test_the_report_counts_by_fault():
    outcomes = [judge(STOP, "repeat", track(t), 2.0, 0.35, resumed=t > 0.5) for t in (0.3, 0.4, 0.9)]
    data = summary([*outcomes, judge(GO, "teach", track(9.0), 2.0, 0.35, resumed=False)])
    assert (data["runs"], data["passed"], data["resumed_by_operator"]) == (4, 3, 1)
    row = data["faults"][0]
    assert (row["fault"], row["runs"], row["passed"]) == ("kill tracker", 3, 2)
    assert row["standstill_p99_s"] == pytest.approx(0.89, abs=0.02)
    assert data["faults"][1]["standstill_p99_s"] is None


def test_the_report_counts_by_what_was_done():
    drop = replace(STOP, name="drop state", how="drop")
    runs = [judge(fault, "repeat", track(0.63), 2.0, 0.35, resumed=False) for fault in (STOP, drop, GO)]
    by_kind = {row["kind"]: row for row in summary(runs)["kinds"]}
    assert {kind: row["runs"] for kind, row in by_kind.items()} == {"drop": 1, "kill": 2}
    assert by_kind["drop"]["late_p99_s"] == pytest.approx(0.38 - 0.25, abs=0.01)


def test_only_a_robot_that_had_to_stop_is_asked_whether_it_stood():
    either = replace(GO, name="hog", how="hog", must=Must.EITHER)
    seen = track(0.4, moves_at=1.2)
    hog, kill = (judge(fault, "repeat", seen, 2.0, 0.35, resumed=False) for fault in (either, STOP))
    assert hog.passed
    assert not kill.passed
    assert [row["hold"] for row in summary([hog, kill])["faults"]] == [None, pytest.approx(0.5, abs=0.01)]


def test_earlier_runs_are_read_again(tmp_path):
    runs = [judge(STOP, "repeat", track(t), 2.0, 0.35, resumed=False) for t in (0.4, 9.0)]
    file = tmp_path / "outcomes.jsonl"
    assert read(file) == []
    file.write_text("".join(json.dumps(one(outcome)) + "\n" for outcome in runs))
    assert summary(read(file))["faults"] == summary(runs)["faults"]
    file.write_text('{"fault": "kill tracker"}\n')
    with pytest.raises(CommandError, match="no report of faults of this version"):
        read(file)


def passed_on(injector, messages, key="vtr/r1/command/desired"):
    sent = []
    for message in messages:
        injector.pass_on(key, message, sent.append, 1)
    return sent


def commands(count):
    return [VelocityCommand(stamp=k, v=float(k), w=0.0) for k in range(count)]


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("none", [0, 1, 2, 3]), ("drop", []), ("double", [0, 0, 1, 1, 2, 2, 3, 3]), ("reorder", [1, 0, 3, 2])],
)
def test_messages_are_lost_doubled_and_reordered(kind, expected):
    injector = Injector()
    injector.obey(Order(kind=kind, key="/command/desired"))
    assert [message.stamp for message in passed_on(injector, commands(4))] == expected
    assert len(passed_on(injector, commands(4), "vtr/r1/state")) == 4, "other topics are left alone"


def test_messages_are_late():
    injector, sent = Injector(), []
    injector.obey(Order(kind="delay", amount=0.05, key="/command"))
    injector.pass_on("vtr/r1/command/desired", commands(1)[0], sent.append, 1)
    assert sent == []
    eventually(lambda: sent, "it comes")


def frame(stamp, level):
    camera = CameraModel.of(
        StereoCamera(width=32, height=24, fx=30.0, fy=30.0, cx=16.0, cy=12.0, baseline=0.2, T_vehicle_camera=np.eye(4))
    )
    image = np.full((24, 32), level, np.uint8)
    return StereoFrame(stamp=stamp, camera=camera, left=image, right=image)


def test_a_camera_freezes_goes_black_and_turns():
    injector = Injector()
    injector.obey(Order(kind="freeze", key="/sensor"))
    frozen = passed_on(injector, [frame(1, 10), frame(2, 20)], "vtr/r1/sensor/stereo/front")
    assert [(one.stamp, one.left.max()) for one in frozen] == [(1, 10), (2, 10)]
    injector.obey(Order(kind="black", key="/sensor"))
    assert passed_on(injector, [frame(3, 10)], "vtr/r1/sensor/stereo/front")[0].left.max() == 0
    injector.obey(Order(kind="extrinsics", amount=0.2, key="/sensor"))
    turned = passed_on(injector, [frame(4, 10)], "vtr/r1/sensor/stereo/front")[0].camera.T_vehicle_camera
    assert np.arctan2(turned[1, 0], turned[0, 0]) == pytest.approx(0.2)


def test_orders_reach_a_process(tmp_path):
    heard = []
    path = tmp_path / "ear.sock"
    orders.listen(path, heard.append)

    class Configuration:
        directory = tmp_path

    (tmp_path / "run").mkdir()
    path.rename(tmp_path / "run" / "chaos-tracker.sock")
    orders.send(Configuration, "tracker", Order(kind="drop", key="/state"))
    eventually(lambda: heard, "the order is heard")
    assert heard[0] == Order(kind="drop", key="/state")
    with pytest.raises(Exception, match="takes no orders"):
        orders.send(Configuration, "estimator", Order(kind="none"))
    assert threading.active_count() < 50


def test_a_command_after_the_base_has_stopped_by_itself_stopped_nothing():
    silent = Fault("hold safety", "safety", "hold", 2.0, Must.STOP, 0.3)
    seen = track(0.34)
    commands = seen.safe_times < 0.02, seen.safe_times > 1.99
    safe = np.concatenate([np.ones(commands[0].sum()), np.zeros(commands[1].sum())])
    seen = replace(seen, safe_times=np.concatenate([seen.safe_times[one] for one in commands]), safe=safe)
    outcome = judge(silent, "repeat", seen, 2.0, 0.35, resumed=False)
    assert (outcome.passed, outcome.why) == (True, "")
    assert np.isnan(outcome.stops_s)
    assert outcome.brakes_s == pytest.approx(0.34)
    assert outcome.standstill_s == pytest.approx(0.34)


@pytest.mark.parametrize(("braked_at", "words"), [(0.31, ""), (0.38, "began to stop after 0.37 s")])
def test_a_base_that_hears_nothing_brakes_by_itself_in_time(braked_at, words):
    silent = Fault("kill safety", "safety", "kill", 2.0, Must.STOP, 0.3)
    times = np.arange(0.0, 2.0, 0.002)
    ticks = np.floor(times / 0.01) * 0.01
    speed = np.clip(1.0 - 0.2 * ticks, 0.9, 1.0) * np.clip(1.0 - (ticks - braked_at + 0.01) / 0.08, 0.0, 1.0)
    seen = Track(times, speed, times[:1], np.ones(1), 0.0)
    outcome = judge(silent, "repeat", seen, 2.0, 0.45, resumed=False)
    assert outcome.brakes_s == pytest.approx(braked_at, abs=0.011)
    assert outcome.passed == (not words)
    assert words in outcome.why


def test_faults_that_had_the_fewest_runs_come_first():
    kills = cases("kill", 1)
    assert {fault.how for _, fault in kills} == {"kill"}
    doing, fault = kills[2]
    had = [unfinished(other, its, "") for its, other in kills if (its, other) != (doing, fault)]
    assert list(islice(in_turn(kills, had), 4)) == [(doing, fault), *kills[:3]]
    assert list(islice(in_turn(kills, []), len(kills) + 1)) == [*kills, kills[0]]


def test_no_kind_of_fault_has_more_runs_than_asked():
    both = cases("kill", 1)[:3] + cases("hog", 1)
    had = [unfinished(both[0][1], both[0][0], "")] * 4
    turns = list(in_turn(both, had, 5))
    assert [fault.how for _, fault in turns].count("kill") == 1
    assert [fault.how for _, fault in turns].count("hog") == 5


def test_a_fault_that_is_none_is_said():
    with pytest.raises(CommandError, match="no fault's name holds 'meteor'"):
        cases("meteor", 1)
