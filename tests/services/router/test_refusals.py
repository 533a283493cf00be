"""The lines are those of the Zenoh that is installed; tests/integration/test_break_in.py has it write them anew."""

from hypothesis import given
from hypothesis import strategies as st

from services.router.refusals import Complaint, Reader, Refusal

ACL = "zenoh::net::routing::interceptor::access_control"
WHO = "2cd0 on Interface(lo)+CertCommonName(viewer.v.02)+Transport(Tls)+2cd0"


def line(text, target=ACL, level="TRACE", thread="09"):
    head = f"\x1b[2m2026-11-26T14:50:49.071349Z\x1b[0m \x1b[35m{level}\x1b[0m rx-0 ThreadId({thread})"
    return f"{head} \x1b[2m{target}\x1b[0m\x1b[2m:\x1b[0m {text}\n".encode()


def dropped(thread="09"):
    return line("Msg intercepted!", "zenoh::net::routing::interceptor", thread=thread)


def read(*lines):
    return list(Reader().read(b"".join(lines)))


def test_a_denied_message_is_a_refusal_once_it_was_dropped():
    denied = line(f"{WHO} is unauthorized to Put (ingress) on vtr/r1/command/safe")
    assert read(denied) == []
    assert read(denied, dropped()) == [Refusal("viewer.v.02", "put", "vtr/r1/command/safe")]


def test_a_link_is_known_by_name_after_its_first_denial():
    first = line(f"{WHO} is unauthorized to Query (ingress) on vtr/r1/mission/command")
    cached = line("Using cached result: 2cd0 is unauthorized to Put (ingress) on vtr/r1/state")
    assert read(first, dropped(), cached, dropped())[1] == Refusal("viewer.v.02", "put", "vtr/r1/state")


def test_what_zenoh_works_out_in_advance_is_nobodys_attempt():
    in_advance = [line(f"{WHO} is unauthorized to Reply ({flow}) on vtr/r1/state") for flow in ("ingress", "egress")]
    assert read(*in_advance, line(f"{WHO} is authorized to Put (ingress) on vtr/r1/state")) == []


def test_what_is_not_passed_on_is_nobodys_attempt():
    assert read(line(f"{WHO} is unauthorized to Put (egress) on vtr/r2/state"), dropped()) == []


def test_threads_are_told_apart():
    one = line(f"{WHO} is unauthorized to Put (ingress) on vtr/r1/a", thread="1")
    other = line(f"{WHO} is unauthorized to Put (ingress) on vtr/r1/b", thread="2")
    assert [r.key for r in read(one, other, dropped("1"), dropped("2"))] == ["vtr/r1/a", "vtr/r1/b"]


def test_what_is_dropped_for_another_reason_is_no_refusal():
    denied = line(f"{WHO} is unauthorized to Put (ingress) on vtr/r1/a")
    assert len(read(denied, dropped(), dropped())) == 1, "one image of many is passed on to the fleet"


def test_a_link_without_rights_is_named_by_who_it_is_of():
    reader = Reader()
    reader.name("2cd0", "viewer.gone.00000001")
    lines = line("2cd0 is unauthorized to Declare Subscriber (ingress) on vtr/r1/state") + dropped()
    assert list(reader.read(lines)) == [Refusal("viewer.gone.00000001", "declare subscriber", "vtr/r1/state")]


def test_links_that_do_not_come_about():
    tls = line(
        "peer sent no certificates. Hint: increase the system open file limit.", "zenoh_link_tls::unicast", "WARN"
    )
    password = line(
        "UsrPwd extension - Recv OpenSyn. Invalid password. at /root/x/usrpwd.rs:461.",
        "zenoh_transport::unicast::establishment::accept", "DEBUG",
    )  # fmt: skip
    assert read(tls, password) == [
        Refusal("", "link", "peer sent no certificates."),
        Refusal("", "link", "Recv OpenSyn. Invalid password."),
    ]


def test_anything_else_that_zenoh_warns_of_is_passed_on():
    text = "Unable to connect to any of [Single(tls/127.0.0.1:1)]. Timeout! at /root/.cargo/orchestrator.rs:388."
    assert read(line(text, "zenoh::net::runtime::orchestrator", "WARN")) == [
        Complaint("Unable to connect to any of [Single(tls/127.0.0.1:1)]. Timeout!")
    ]


WHOLE = line(f"{WHO} is unauthorized to Put (ingress) on vtr/r1/a") + b"\xff unauthorized \x00\n\n" + dropped()


@given(st.lists(st.integers(0, len(WHOLE)), max_size=8))
def test_the_log_may_come_in_any_pieces_and_hold_anything(cuts):
    reader, cuts = Reader(), sorted(cuts)
    pieces = [WHOLE[begin:end] for begin, end in zip([0, *cuts], [*cuts, len(WHOLE)], strict=True)]
    assert [r for piece in pieces for r in reader.read(piece)] == [Refusal("viewer.v.02", "put", "vtr/r1/a")]


def test_endless_names_and_threads_cost_bounded_memory():
    reader = Reader()
    for n in range(3000):
        denied = f"{n:x} on CertCommonName(viewer.v{n}.02) is unauthorized to Put (ingress) on vtr/r1/a"
        list(reader.read(line(denied, thread=str(n))))
    list(reader.read(b"x" * 10_000_000))
    assert max(len(reader._denied), len(reader._names)) <= 1024
    assert len(reader._rest) <= 1 << 20
