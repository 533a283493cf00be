"""Processes under the supervisor: started, restarted, counted, refused twice, and gone at the end."""

import configparser
import json
import os
import signal

import psutil
import pytest

from cli import client
from cli.errors import CommandError
from cli.processes import ROBOT
from cli.robot import load
from cli.supervision.client import count_restarts
from cli.supervision.files import SupervisorFiles, render
from cli.supervision.supervised import Supervised
from common import topics
from common.errors import ConfigurationError
from common.messages import GraphQuery
from tests.processes import eventually

LOG = """\
2026-11-22 21:04:02,181 INFO supervisord started with pid 1
2026-11-22 21:04:02,214 INFO spawned: 'router' with pid 2
2026-11-22 21:04:05,079 INFO spawned: 'router' with pid 3
2026-11-22 21:05:02,181 INFO supervisord started with pid 4
2026-11-22 21:05:02,214 INFO spawned: 'router' with pid 5
2026-11-22 21:05:02,215 INFO spawned: 'safety' with pid 6
2026-11-22 21:05:06,134 WARN exited: router (terminated by SIGKILL; not expected)
2026-11-22 21:05:07,335 INFO spawned: 'router' with pid 7
2026-11-22 21:05:09,335 INFO spawned: 'router' with pid 8
"""


def test_restarts_are_counted_since_the_supervisor_began():
    assert count_restarts(LOG.splitlines()) == {"router": 2, "safety": 0}


def test_the_generated_configuration_runs_the_whole_table(write_config):
    parser = configparser.RawConfigParser()
    parser.read_string(render(SupervisorFiles.of(load(write_config())), ROBOT))
    programs = parser["group:robot"]["programs"].split(",")
    assert programs == [process.name for process in ROBOT]
    for process in ROBOT:
        section = parser[f"program:{process.name}"]
        assert section["command"].endswith(f"-m {process.module}")
        assert section["autorestart"] == "true"


def test_a_percent_sign_in_a_path_is_no_expansion_and_a_comment_is_refused(write_config, tmp_path):
    config = write_config()
    text = config.read_text()
    config.write_text(text.replace(str(tmp_path / "data"), str(tmp_path / "50% full")))
    assert "50%% full" in render(SupervisorFiles.of(load(config)), ROBOT)
    config.write_text(text.replace(str(tmp_path / "data"), str(tmp_path / "data ;old")))
    with pytest.raises(ConfigurationError, match=" ;old"):
        render(SupervisorFiles.of(load(config)), ROBOT)


def test_a_deep_directory_has_its_socket_elsewhere(write_config, tmp_path):
    config = write_config()
    deep = tmp_path / ("d" * 120)
    config.write_text(config.read_text().replace(str(tmp_path / "data"), str(deep)))
    assert len(bytes(SupervisorFiles.of(load(config)).socket)) < 100


def test_three_processes_live_die_and_live_again(supervised, vtr):
    robot = supervised("router", "mapstore", "planner")
    seen = []
    robot.start()
    robot.wait_ready(on_change=seen.append)
    assert seen[-1] == {"router", "mapstore", "planner"}

    with client.connect(robot.config) as bus:
        assert bus.ask(topics.MAPS, GraphQuery()).maps == []
    assert json.loads(vtr("maps", "ls", "--json", "--config", robot.config.path).out) == {"maps": []}
    assert "no map" in vtr("maps", "show", "20261122", "--config", robot.config.path).sentence
    assert "navigator" in vtr("repeat", "dock", "--config", robot.config.path).sentence

    with pytest.raises(CommandError, match="already running"):
        Supervised(robot.config.path, robot.table).start()

    before = {state.name: state for state in robot.processes()}
    os.kill(before["mapstore"].pid, signal.SIGKILL)
    eventually(lambda: _state(robot, "mapstore").pid not in (None, before["mapstore"].pid), "mapstore is restarted")
    robot.wait_ready()
    assert _state(robot, "mapstore").restarts == 1
    assert _state(robot, "planner").pid == before["planner"].pid

    rows = {row["name"]: row for row in json.loads(vtr("ps", "--json", "--config", robot.config.path).out)["processes"]}
    assert rows["mapstore"]["restarts"] == 1
    assert rows["router"]["pid"] == before["router"].pid
    assert rows["router"]["memory_mb"] > 10

    robot.stop()
    assert robot.processes() == []
    assert not robot.running()


def test_killing_the_supervisor_leaves_no_process_behind(supervised):
    robot = supervised("router")
    robot.start()
    robot.wait_ready()
    process = psutil.Process(_state(robot, "router").pid)
    os.kill(robot.client.pid(), signal.SIGKILL)
    eventually(lambda: not process.is_running() or process.status() == psutil.STATUS_ZOMBIE, "the router is gone")


def test_a_detached_robot_is_stopped_by_down(supervised, vtr):
    robot = supervised("router")
    robot.start(detached=True)
    robot.wait_ready()
    result = vtr("down", robot.config.path, "--json")
    assert json.loads(result.out) == {"robot": "r1", "stopped": True}
    eventually(lambda: not robot.running(), "the supervisor is gone")


def test_what_is_not_up_in_time_is_named_with_its_log(supervised):
    robot = supervised("router")
    robot.start()
    with pytest.raises(CommandError, match=r"router.*log/router\.log"):
        robot.wait_ready(deadline=0.01)


def _state(robot, name):
    return next(state for state in robot.processes() if state.name == name)
