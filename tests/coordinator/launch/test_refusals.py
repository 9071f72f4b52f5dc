"""What a router says of the messages and links that it has refused."""

from coordinator.launch.refusals import Refusals

_ABOUT = (
    "\x1b[2m2026-11-27T06:58:06Z\x1b[0m \x1b[35mTRACE\x1b[0m rx-0 ThreadId({}) \x1b[2mzenoh::net::routing::interceptor"
)
_WHO = "b361 on Interface(lo)+CertCommonName(anna)+Transport(Tls)+b361 is unauthorized to Put (ingress) on k/best"
INTERCEPTED = _ABOUT.format("09") + "\x1b[0m\x1b[2m:\x1b[0m Msg intercepted!"
UNAUTHORIZED = _ABOUT.format("09") + f"::access_control\x1b[0m\x1b[2m:\x1b[0m {_WHO}"


def read(*lines):
    said = []
    refusals = Refusals(said.append)
    for now, line in lines:
        refusals.read(line, now)
    return said


def test_a_refused_message_is_said_at_once():
    assert read((0.0, UNAUTHORIZED), (0.0, INTERCEPTED)) == ["refused anna: Put on k/best"]


def test_a_permission_without_a_message_is_no_refusal():
    assert read((0.0, UNAUTHORIZED), (0.0, UNAUTHORIZED)) == []


CACHING = UNAUTHORIZED.replace(_WHO, "ACL (ingress): caching permissions for `k/best` ...")
CACHED = UNAUTHORIZED.replace(
    _WHO, "Using cached result: b361 is unauthorized to Declare Subscriber (ingress) on k/best"
)


def test_what_is_said_in_advance_blames_nobody_for_the_message_of_a_session_without_rules():
    lines = [(0.0, line) for line in (CACHING, *[UNAUTHORIZED] * 9, INTERCEPTED, UNAUTHORIZED, INTERCEPTED)]
    assert read(*lines) == ["refused somebody who is no member: a message", "refused anna: Put on k/best"]


def test_what_is_not_said_in_advance_after_all_swallows_no_later_verdict():
    lines = [(0.0, line) for line in (CACHING, INTERCEPTED, UNAUTHORIZED, INTERCEPTED)]
    assert read(*lines) == ["refused somebody who is no member: a message", "refused anna: Put on k/best"]


def test_a_verdict_without_a_name_is_about_the_session_that_had_one():
    lines = [(0.0, line) for line in (CACHING, *[UNAUTHORIZED] * 9, CACHED, INTERCEPTED)]
    assert read(*lines) == ["refused anna: Declare Subscriber on k/best"]


def test_a_message_that_may_pass_is_no_refusal_of_the_next_one():
    lines = [(0.0, line) for line in (UNAUTHORIZED, UNAUTHORIZED.replace("unauthorized", "authorized"), INTERCEPTED)]
    assert read(*lines) == ["refused somebody who is no member: a message"]


def test_the_message_of_another_thread_is_not_taken_for_it():
    other = INTERCEPTED.replace("ThreadId(09)", "ThreadId(10)")
    assert read((0.0, UNAUTHORIZED), (0.0, other)) == ["refused somebody who is no member: a message"]


def test_many_are_counted_and_said_once_a_minute():
    lines = [(now, line) for now in (0.0, 1.0, 2.0, 60.5) for line in (UNAUTHORIZED, INTERCEPTED)]
    assert read(*lines) == ["refused anna: Put on k/best", "refused anna: Put on k/best (3 times)"]


def test_a_name_that_shows_no_certificate():
    line = UNAUTHORIZED.replace("+CertCommonName(anna)", "")
    assert read((0.0, line), (0.0, INTERCEPTED)) == ["refused somebody who is no member: Put on k/best"]


def test_a_refused_certificate():
    line = "WARN acc-0 ThreadId(05) zenoh_link_tls::unicast: invalid peer certificate: UnknownIssuer. Hint: increase"
    assert read((0.0, line)) == ["refused a link: invalid peer certificate: UnknownIssuer"]
    expired = line.replace("UnknownIssuer", "certificate expired: ({} seconds ago)")
    assert len(read((0.0, expired.format(1)), (1.0, expired.format(2)))) == 1


def test_messages_to_many_keys_are_of_one_kind():
    lines = []
    for number in range(3000):
        lines += [(0.0, UNAUTHORIZED.replace("k/best", f"k/{number}")), (0.0, INTERCEPTED)]
    assert read(*lines) == ["refused anna: Put on k/0"]


def test_countless_kinds_take_no_countless_memory():
    lines = []
    for number in range(3000):
        lines += [(0.0, UNAUTHORIZED.replace("anna", f"a{number}")), (0.0, INTERCEPTED)]
    said = read(*lines)
    assert len(said) == 1001
    assert said[-1] == "refused others on k/best"
    assert read(*lines, (99.0, UNAUTHORIZED), (99.0, INTERCEPTED))[-1] == "refused anna: Put on k/best"
