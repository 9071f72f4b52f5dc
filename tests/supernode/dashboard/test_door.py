"""Where a dashboard may listen, and what is said where it may not."""

import socket

import pytest

from problems import BadInput
from supernode.dashboard.door import Door, door_of

TOKEN = "s3cret-s3cret-s3cret"


def test_loopback_needs_no_token(tmp_path):
    assert door_of("127.0.0.1:8080", None) == Door("127.0.0.1", 8080)
    assert door_of("[::1]:0", None) == Door("::1", 0)
    assert door_of("localhost:80", None).is_local


def test_any_other_address_needs_one(tmp_path):
    with pytest.raises(BadInput, match="--dashboard-token-file: needed"):
        door_of("0.0.0.0:8080", None)
    with pytest.raises(BadInput, match="--dashboard-token-file: needed"):
        door_of("example.org:8080", None)
    (tmp_path / "token").write_text(TOKEN + "\n")
    assert door_of("0.0.0.0:8080", str(tmp_path / "token")) == Door("0.0.0.0", 8080, TOKEN)


@pytest.mark.parametrize("address", ["8080", "127.0.0.1", "127.0.0.1:http", "127.0.0.1:65536", "a b:1", "::1:80"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(BadInput, match="expected an address"):
        door_of(address, None)


@pytest.mark.parametrize("text", ["", "short", "sixteen letters, spaces"])
def test_what_is_no_token_is_refused(tmp_path, text):
    (tmp_path / "token").write_text(text)
    with pytest.raises(BadInput, match=r"--dashboard-token-file: .* expected"):
        door_of("127.0.0.1:0", str(tmp_path / "token"))
    with pytest.raises(BadInput, match=r"--dashboard-token-file: .* expected a token"):
        door_of("127.0.0.1:0", str(tmp_path / "missing"))


def test_an_address_that_is_taken_is_an_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(BadInput, match="cannot listen"):
            Door("127.0.0.1", taken.getsockname()[1]).listen()
