"""Connections that send nothing."""

import contextlib
import http.client
import socket

from live_service import until

from supernode.dashboard import connections


def is_closed(sock):
    """Whether the other end has closed it; nothing is expected from there."""
    with contextlib.suppress(BlockingIOError):
        return sock.recv(1, socket.MSG_DONTWAIT) == b""
    return False


def test_one_address_does_not_take_up_all_by_saying_nothing(shown, monkeypatch):
    monkeypatch.setattr(connections, "MOST_OF_ONE", 3)
    with contextlib.ExitStack() as stack:
        here = ("127.0.0.1", shown.port)
        socks = [stack.enter_context(socket.create_connection(here)) for _ in range(5)]
        until(lambda: sum(is_closed(each) for each in socks) == 2)
        other = stack.enter_context(socket.create_connection(here, source_address=("127.0.0.2", 0)))
        other.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert other.recv(9) == b"HTTP/1.1 "
        assert [is_closed(each) for each in socks].count(False) == 3
    until(lambda: answers(shown))


def answers(shown):
    with contextlib.suppress(OSError, http.client.HTTPException):  # the server may not have seen yet that they are gone
        return shown.ask("GET", "/")[0] == 200
    return False
