import pytest

from wire.seal import NOT_OURS, SECRET_BYTES, Seal
from wire.strict import Rejected

SECRET = bytes(range(SECRET_BYTES))
KEY = "supernode/c1/node/*/control"


def reason(seal: Seal, key: str, sealed: bytes) -> str:
    with pytest.raises(Rejected) as caught:
        seal.open(key, sealed)
    return caught.value.reason


@pytest.mark.parametrize("payload", [b"", b"x", b"y" * 100_000])
def test_what_was_closed_opens_for_who_knows_the_secret(payload: bytes) -> None:
    assert Seal(SECRET).open(KEY, Seal(SECRET).close(KEY, payload)) == payload


def test_whoever_does_not_know_the_secret_is_refused() -> None:
    assert reason(Seal(SECRET), KEY, Seal(bytes(SECRET_BYTES)).close(KEY, b"drop")) == NOT_OURS


@pytest.mark.parametrize("length", [0, 1, 31, 32, 40, 47])
def test_what_is_shorter_than_a_seal_is_refused(length: int) -> None:
    assert reason(Seal(SECRET), KEY, bytes(length)) == NOT_OURS


def test_every_byte_counts() -> None:
    seal, sealed = Seal(SECRET), Seal(SECRET).close(KEY, b"drop")
    for place in range(len(sealed)):
        changed = bytes(byte ^ (number == place) for number, byte in enumerate(sealed))
        assert reason(seal, KEY, changed) == NOT_OURS
    assert reason(seal, KEY, sealed + b"x") == NOT_OURS
    assert seal.open(KEY, sealed) == b"drop"


def test_a_command_is_for_those_alone_whom_it_was_sealed_for() -> None:
    sealed = Seal(SECRET).close("supernode/c1/node/3/control", b"drop")
    for key in (KEY, "supernode/c1/node/4/control", "supernode/c2/node/3/control", "supernode/c1/spy/control"):
        assert reason(Seal(SECRET), key, sealed) == NOT_OURS


def test_no_command_is_heard_twice_in_whatever_order_they_come() -> None:
    sender, hearer = Seal(SECRET), Seal(SECRET)
    sealed = [sender.close(KEY, bytes([number])) for number in range(10)]
    for number in (3, 0, 9, 4, 1, 2, 8, 5, 7, 6):
        assert hearer.open(KEY, sealed[number]) == bytes([number])
    assert {reason(hearer, KEY, each) for each in sealed} == {"repeated"}
    assert Seal(SECRET).open(KEY, sealed[3]) == bytes([3]), "another process has not heard it"


def test_who_comes_very_late_counts_as_heard() -> None:
    sender, hearer = Seal(SECRET), Seal(SECRET)
    sealed = [sender.close(KEY, b"") for _ in range(3000)]
    hearer.open(KEY, sealed[2999])
    assert reason(hearer, KEY, sealed[2999 - 1024]) == "repeated"
    assert hearer.open(KEY, sealed[2999 - 1023]) == b""
    assert reason(hearer, KEY, sealed[2999 - 1023]) == "repeated"


def test_senders_count_each_by_itself() -> None:
    hearer = Seal(SECRET)
    assert [hearer.open(KEY, Seal(SECRET).close(KEY, b"go")) for _ in range(3)] == [b"go"] * 3


def test_the_secret_is_not_in_what_is_sent() -> None:
    assert SECRET not in Seal(SECRET).close(KEY, b"drop")
