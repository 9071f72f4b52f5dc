"""Where a dashboard may listen, and what is said where it may not."""

import socket

import pytest

from problems import BadInput
from supernode.dashboard.listen_address import ListenAddress, listen_address_of

TOKEN = "s3cret-s3cret-s3cret"


def write_token(path, text):
    path.touch(0o600)
    path.write_text(text)


def test_loopback_needs_no_token(tmp_path):
    assert listen_address_of("127.0.0.1:8080", None) == ListenAddress("127.0.0.1", 8080)
    assert listen_address_of("[::1]:0", None) == ListenAddress("::1", 0)
    assert listen_address_of("localhost:80", None).is_local


def test_any_other_address_needs_one(tmp_path):
    with pytest.raises(BadInput, match="--dashboard-token-file: needed"):
        listen_address_of("0.0.0.0:8080", None)
    with pytest.raises(BadInput, match="--dashboard-token-file: needed"):
        listen_address_of("example.org:8080", None)
    write_token(tmp_path / "token", TOKEN + "\n")
    assert listen_address_of("0.0.0.0:8080", str(tmp_path / "token")) == ListenAddress("0.0.0.0", 8080, TOKEN)


@pytest.mark.parametrize("address", ["8080", "127.0.0.1", "127.0.0.1:http", "127.0.0.1:65536", "a b:1", "::1:80"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(BadInput, match="expected an address"):
        listen_address_of(address, None)


@pytest.mark.parametrize("text", ["", "short", "sixteen letters, spaces"])
def test_what_is_no_token_is_refused(tmp_path, text):
    write_token(tmp_path / "token", text)
    with pytest.raises(BadInput, match=r"--dashboard-token-file: .* expected"):
        listen_address_of("127.0.0.1:0", str(tmp_path / "token"))
    with pytest.raises(BadInput, match=r"--dashboard-token-file: .* expected a token"):
        listen_address_of("127.0.0.1:0", str(tmp_path / "missing"))


@pytest.mark.parametrize("mode", [0o644, 0o640, 0o604])
def test_a_token_that_others_can_read_is_refused(tmp_path, mode):
    write_token(tmp_path / "token", TOKEN)
    (tmp_path / "token").chmod(mode)
    with pytest.raises(BadInput, match=rf"--dashboard-token-file: .* only its owner can read, found mode {mode:o}"):
        listen_address_of("0.0.0.0:8080", str(tmp_path / "token"))


def test_an_address_that_is_taken_is_an_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(BadInput, match="cannot listen"):
            ListenAddress("127.0.0.1", taken.getsockname()[1]).listen()
