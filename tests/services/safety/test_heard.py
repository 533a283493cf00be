from common.bus.envelope import Source
from services.safety.heard import Speakers
from services.safety.waiting import Waiting

FIRST, SECOND = Source("r1", "tracker", "first"), Source("r1", "tracker", "second")
OTHER = Source("r1", "navigator", "third")


def test_a_restarted_process_is_believed_at_once():
    connected = {FIRST}
    speakers = Speakers(connected, silence=0.25)
    assert speakers.believes(FIRST, 10.0)
    connected.remove(FIRST)
    connected.add(SECOND)
    assert speakers.believes(SECOND, 10.1)
    assert not speakers.believes(FIRST, 10.2)
    assert not speakers.believes(FIRST, 1000.0)


def test_a_life_that_is_not_connected_is_never_believed_and_takes_nobodys_place():
    speakers = Speakers({SECOND}, silence=0.25)
    assert not speakers.believes(FIRST, 10.0)
    assert speakers.believes(SECOND, 10.01)


def test_two_at_once_under_one_name_do_not_take_turns():
    speakers = Speakers({FIRST, SECOND}, silence=0.25)
    believed = [source for step in range(40) for source in (FIRST, SECOND) if speakers.believes(source, 0.05 * step)]
    assert set(believed) == {FIRST}
    assert len(believed) == 40
    assert not speakers.believes(SECOND, 2.15)
    assert speakers.believes(SECOND, 2.3)
    assert not speakers.believes(FIRST, 2.35)


def test_processes_with_other_names_do_not_matter():
    speakers = Speakers({FIRST, OTHER}, silence=0.25)
    assert speakers.believes(FIRST, 10.0)
    assert speakers.believes(OTHER, 10.01)


def test_a_sample_that_arrives_right_after_a_hang_is_as_old_as_the_hang_was_long():
    waiting = Waiting(period=0.02)
    for now in (10.0, 10.02, 10.05):
        waiting.cycle(now)
    assert waiting.seconds(10.04) == 0.0
    waiting.cycle(11.05)
    assert waiting.seconds(10.03) == 0.0
    assert abs(waiting.seconds(11.049) - 1.0) < 1e-9
    assert abs(waiting.seconds(11.1) - 1.0) < 1e-9
    assert waiting.seconds(11.2) == 0.0
