"""Where a dashboard may listen, and what is said where it may not."""

import socket

import pytest

from problems import BadInput
from supernode.dashboard.listen_address import ListenAddress, listen_address_of

TOKEN = "s3cret-s3cret-s3cret"


def test_loopback_needs_no_token():
    assert listen_address_of("127.0.0.1:8080") == ListenAddress("127.0.0.1", 8080)
    assert listen_address_of("[::1]:0") == ListenAddress("::1", 0)
    assert listen_address_of("localhost:80").is_local


@pytest.fixture
def token_file(tmp_path):
    path = tmp_path / "token"
    path.touch(0o600)
    path.write_text(TOKEN + "\n")
    return str(path)


def test_any_other_address_needs_a_token(certified):
    for address in ("0.0.0.0:8080", "example.org:8080"):
        with pytest.raises(BadInput, match="--dashboard-token-file: needed"):
            listen_address_of(address, None, *certified())


def test_any_other_address_needs_tls_too_or_the_word_that_it_has_none(token_file, certified):
    with pytest.raises(BadInput, match="--dashboard-cert and --dashboard-key: needed"):
        listen_address_of("0.0.0.0:8080", token_file)
    files = certified()
    tls = listen_address_of("0.0.0.0:8080", token_file, *files)
    assert tls == ListenAddress("0.0.0.0", 8080, {TOKEN: "full"}, *files)
    insecure = listen_address_of("0.0.0.0:8080", token_file, insecure=True)
    assert insecure == ListenAddress("0.0.0.0", 8080, {TOKEN: "full"})
    with pytest.raises(BadInput, match="--dashboard-insecure: expected none with --dashboard-cert"):
        listen_address_of("0.0.0.0:8080", token_file, *files, insecure=True)


def test_a_certificate_and_a_key_come_together(certified):
    certificate, key = certified()
    with pytest.raises(BadInput, match="--dashboard-cert: expected --dashboard-key too"):
        listen_address_of("127.0.0.1:0", None, certificate)
    with pytest.raises(BadInput, match="--dashboard-key: expected --dashboard-cert too"):
        listen_address_of("127.0.0.1:0", None, None, key)


def test_nothing_secret_is_printed_with_it():
    listen_address = ListenAddress("127.0.0.1", 0, {TOKEN: "full"})
    assert TOKEN not in repr(listen_address)
    assert listen_address.session_key not in repr(listen_address)
    assert listen_address.session_key != ListenAddress("127.0.0.1", 0).session_key


@pytest.mark.parametrize("address", ["8080", "127.0.0.1", "127.0.0.1:http", "127.0.0.1:65536", "a b:1", "::1:80"])
def test_what_is_no_address_is_refused(address):
    with pytest.raises(BadInput, match="expected an address"):
        listen_address_of(address)


def test_an_address_that_is_taken_is_an_error():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(BadInput, match="cannot listen"):
            ListenAddress("127.0.0.1", taken.getsockname()[1]).listen()
