from __future__ import annotations

import json
import subprocess
import sys
import threading

import pytest
import structlog

from common import logs


@pytest.fixture(autouse=True)
def _restore():
    yield
    structlog.reset_defaults()


def _say(text: str) -> None:
    log = structlog.get_logger()
    log.info(text)
    thread = threading.Thread(target=lambda: log.warning("from a thread", said=text, figure=1.5))
    thread.start()
    thread.join()


def test_robot_and_process_stand_in_each_line_of_any_thread(capsys):
    logs.configure("r1", "tracker")
    _say("hello")
    output = capsys.readouterr()
    lines = output.err.splitlines()
    assert not output.out
    assert len(lines) == 2
    for line in lines:
        assert "robot=r1" in line
        assert "process=tracker" in line
        assert "timestamp=" in line
    assert 'event="from a thread"' in lines[1]
    assert "figure=1.5" in lines[1]


def test_an_error_with_its_trace_and_a_text_of_many_lines_stay_one_line(capsys):
    for json_lines in (False, True):
        logs.configure("r1", "tracker", json=json_lines)
        try:
            _ = {}["two\nlines"]
        except KeyError:
            structlog.get_logger().exception("failed\nbadly", place='a "quoted"\nkey')
        assert len(capsys.readouterr().err.splitlines()) == 1


def test_json_lines_can_be_read_back(capsys):
    logs.configure("r1", "tracker", json=True)
    _say("hello")
    for line in capsys.readouterr().err.splitlines():
        event = json.loads(line)
        assert (event["robot"], event["process"]) == ("r1", "tracker")


def test_lines_below_the_level_are_not_written(capsys):
    logs.configure("r1", "tracker", "warning")
    _say("hello")
    assert [line.split("level=")[1].split()[0] for line in capsys.readouterr().err.splitlines()] == ["warning"]


def test_lines_of_many_threads_are_not_mixed():
    script = """
import threading, structlog
from common import logs
logs.configure("r1", "tracker", json=True)
def speak():
    for i in range(200):
        structlog.get_logger().info("x" * 200, i=i)
threads = [threading.Thread(target=speak) for _ in range(4)]
[t.start() for t in threads]; [t.join() for t in threads]
"""
    lines = subprocess.run(
        [sys.executable, "-c", script], stderr=subprocess.PIPE, text=True, check=True
    ).stderr.splitlines()
    assert len(lines) == 800
    assert all(json.loads(line)["process"] == "tracker" for line in lines)
