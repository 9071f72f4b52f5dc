"""Namespaces of Linux in which a process has no network (user_namespaces(7), network_namespaces(7)).

Python names these system calls from 3.12 on only.
"""

import ctypes
import os
import socket
from pathlib import Path

_USER, _NETWORK = 0x10000000, 0x40000000  # CLONE_NEWUSER and CLONE_NEWNET of sched.h
_LIBC = ctypes.CDLL(None, use_errno=True)

Namespaces = tuple[int, int]
"""Descriptors of a user namespace and of a network namespace that belongs to it."""


def without_network() -> Namespaces:
    """Return new namespaces without a network, not even a loopback that is up; this process stays where it is.

    Sockets in the file system work across network namespaces.

    Raises:
        OSError: if the system does not let this user make them.
    """
    ours, theirs = socket.socketpair()
    with ours, theirs:
        process = os.fork()
        if process == 0:
            _make(theirs)
        said, descriptors, _, _ = socket.recv_fds(ours, 16, 2)
        os.waitpid(process, 0)
    if len(descriptors) != 2:
        raise OSError(int(said), os.strerror(int(said)))
    user, network = descriptors
    return user, network


def _make(tell: socket.socket) -> None:
    """Make the namespaces in a child, and send their descriptors, or the error's number; this never returns."""
    try:
        user, group = os.geteuid(), os.getegid()
        _check(_LIBC.unshare(_USER | _NETWORK))
        # Each number stands for itself, so that files seem to belong to whom they do. Groups need the first line.
        for name, text in (("setgroups", "deny"), ("uid_map", f"{user} {user} 1"), ("gid_map", f"{group} {group} 1")):
            Path("/proc/self", name).write_text(text)
        found = [os.open(f"/proc/self/ns/{name}", os.O_RDONLY) for name in ("user", "net")]
        socket.send_fds(tell, [b"!"], found)
    except OSError as error:
        tell.send(str(error.errno).encode())
    finally:
        os._exit(0)


def enter(namespaces: Namespaces) -> None:
    """Enter namespaces, for good. The process must have one thread only.

    Raises:
        OSError: if the system refuses.
    """
    for descriptor, kind in zip(namespaces, (_USER, _NETWORK), strict=True):
        _check(_LIBC.setns(descriptor, kind))


def _check(answer: int) -> None:
    if answer != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
