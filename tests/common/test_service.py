from __future__ import annotations

import signal
import subprocess
import sys

import psutil
import pytest

from common import topics
from tests.processes import ROOT, eventually

END_S = 10.0


def ready(process: subprocess.Popen[str]) -> None:
    """Waits until the service's main has printed a line."""
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"


def ended(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, errors = process.communicate(timeout=END_S)
    return process.returncode, errors


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_a_service_cleanly(start, number):
    process = start("print('ready', flush=True); service.stop.wait()")
    ready(process)
    process.send_signal(number)
    code, errors = ended(process)
    assert code == 0
    assert "event=ended" in errors
    assert "robot=r1 process=sensors" in errors


READY = "print('ready', flush=True)\n"


@pytest.mark.parametrize(
    "deaf",
    [
        READY + "while True: time.sleep(60)",
        READY + "while True: pass",
        READY + "lock = threading.Lock(); lock.acquire(); lock.acquire()",
        # It is ready when another thread finds the main thread at the lock, where no handler of Python's can run.
        """
        import ctypes
        lock, mutex = ctypes.CDLL(None).pthread_mutex_lock, bytes(64)
        lock(mutex)
        threading.Timer(0.5, lambda: print("ready", flush=True)).start()
        lock(mutex)
        """,
    ],
    ids=["sleeps", "computes", "locked", "native code"],
)
def test_a_service_that_does_not_listen_is_ended_by_force_within_two_seconds(start, deaf):
    process = start(deaf)
    ready(process)
    process.send_signal(signal.SIGTERM)
    code = process.wait(timeout=2.0)
    assert code == 70
    assert "did not stop in time" in process.communicate()[1]


def test_an_uncaught_error_ends_a_service_with_status_1_and_its_trace_in_the_log(start):
    code, errors = ended(start("raise ZeroDivisionError('unlucky')"))
    assert code == 1
    assert "unlucky" in errors
    assert "Traceback" in errors


def test_a_known_error_ends_a_service_with_status_1_and_its_sentence(start):
    code, errors = ended(start("from common.errors import GraphError\nraise GraphError('no such vertex')"))
    assert code == 1
    assert "no such vertex" in errors
    assert "Traceback" not in errors


def test_a_failing_thread_ends_its_service_with_status_1(start):
    code, errors = ended(start("service.thread(lambda: 1 / 0, 'worker')\nservice.stop.wait()"))
    assert code == 1
    assert "division by zero" in errors
    assert "thread=worker" in errors


def test_a_thread_that_works_on_after_the_stop_spoils_nothing(start):
    main = """
        def work():
            publisher = service.bus.publisher(topics.HEALTH, "sensors")
            while True:
                publisher.put(service._health())
        service.thread(work, "worker")
        print("ready", flush=True)
        service.stop.wait()
    """
    process = start(main)
    ready(process)
    process.terminate()
    assert ended(process)[0] == 0


def test_a_child_dies_with_its_killed_parent(robot):
    child = """
from common.service import run
run("sensors", lambda service: (print("ready", flush=True), service.stop.wait()))
"""
    script = f"""
import subprocess, sys
command = [sys.executable, "-c", {child!r}, "--config", {str(robot.config)!r}]
child = subprocess.Popen(command, stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
child.wait()
"""
    with subprocess.Popen([sys.executable, "-c", script], cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        parent.kill()
        parent.wait()

    def gone() -> bool:
        try:
            return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            return True

    eventually(gone, "the child is gone")


def test_a_router_whose_port_is_in_use_says_so_in_one_sentence(robot):
    command = [sys.executable, "-m", "services.router", "--config", str(robot.config)]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=END_S, check=False)
    assert result.returncode != 0
    assert "port in use" in result.stderr
    assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize("text", [None, "[robot]\nnam = 'x'\n", "[robot\n"])
def test_a_wrong_configuration_is_said_in_one_sentence(start, tmp_path, text):
    path = tmp_path / "robot.toml"
    if text is not None:
        path.write_text(text)
    code, errors = ended(start("pass", config=str(path)))
    assert code == 1
    assert len(errors.splitlines()) == 1
    assert errors.startswith("sensors: ")


def test_no_configuration_at_all_is_said_with_the_usage():
    result = subprocess.run(
        [sys.executable, "-m", "services.router"], cwd=ROOT, capture_output=True, text=True, check=False, env={}
    )
    assert result.returncode == 2
    assert "--config" in result.stderr


def test_a_service_waits_for_its_router_and_can_be_stopped_meanwhile(start, tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text('[robot]\nname = "r1"\n[bus]\nendpoint = "tcp/127.0.0.1:1"\n')
    process = start("raise AssertionError", config=str(path))
    eventually(lambda: len(psutil.Process(process.pid).threads()) > 1, "Zenoh is at work")
    process.terminate()
    assert process.wait(timeout=END_S) != 1


def test_health_tells_rates_stages_and_drops(start, connect):
    bus = connect("navigator")
    reports = bus.subscribe(topics.HEALTH, "sensors")
    main = """
        from common.messages import WheelOdometry
        publisher = service.bus.publisher(topics.WHEEL_ODOMETRY)
        while not service.stop.wait(0.02):
            with service.stage("step"):
                publisher.put(WheelOdometry(stamp=1, v=1.0, w=0.0))
    """
    process = start(main)
    report = eventually(lambda: reports.wait(1.0), "a report arrives").message
    assert report.pid == process.pid
    assert report.rates["vtr/r1/sensor/odometry"] > 0
    assert report.stages["step"].count > 0
    assert report.stages["step"].p99 >= report.stages["step"].p50 > 0
    assert report.memory_mb > 1
    process.terminate()
    assert ended(process)[0] == 0
