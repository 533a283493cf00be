import gc
import threading

import pytest
from structlog.testing import capture_logs

from common.priority import be_on_time


@pytest.fixture
def system(monkeypatch):
    """What the system is asked for; ``refuse`` names what it does not allow."""

    class System:
        refuse: frozenset[str] = frozenset()

        def __init__(self):
            self.asked = []

        def ask(self, what, thread):
            if what in self.refuse:
                raise PermissionError(1, "Operation not permitted")
            self.asked.append((what, thread))

    system = System()
    monkeypatch.setattr(gc, "freeze", lambda: None)
    monkeypatch.setattr("os.sched_setscheduler", lambda thread, *_: system.ask("real time", thread))
    monkeypatch.setattr("os.setpriority", lambda _, thread, __: system.ask("nice", thread))
    return system


def test_every_thread_runs_in_real_time_where_that_is_allowed(system):
    done = threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    try:
        with capture_logs() as logs:
            be_on_time()
    finally:
        done.set()
        other.join()
    assert {threading.main_thread().native_id, other.native_id} <= {thread for _, thread in system.asked}
    assert {what for what, _ in system.asked} == {"real time"}
    assert [entry["log_level"] for entry in logs] == ["info"]


@pytest.mark.parametrize(
    ("refuse", "asked", "words"),
    [(["real time"], {"nice"}, "a little"), (["real time", "nice"], set(), "LimitRTPRIO")],
)
def test_without_the_right_to_it_a_sentence_says_so_and_the_process_goes_on(system, refuse, asked, words):
    system.refuse = frozenset(refuse)
    with capture_logs() as logs:
        be_on_time()
    assert {what for what, _ in system.asked} == asked
    (entry,) = logs
    assert entry["log_level"] == "warning"
    assert words in entry["event"]


@pytest.mark.usefixtures("system")
def test_a_thread_that_ends_meanwhile_is_no_refusal(monkeypatch):
    def gone(*_):
        raise ProcessLookupError(3, "No such process")

    monkeypatch.setattr("os.sched_setscheduler", gone)
    with capture_logs() as logs:
        be_on_time()
    assert [entry["log_level"] for entry in logs] == ["info"]
