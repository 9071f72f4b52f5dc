"""Namespaces of Linux in which a process has no network, or a network or a disk of its own: user_namespaces(7).

Python names these system calls from 3.12 on only.
"""

import contextlib
import ctypes
import os
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

_USER, _NETWORK, _MOUNTS = 0x10000000, 0x40000000, 0x00020000  # CLONE_NEWUSER, _NEWNET and _NEWNS of sched.h
_PRIVATE, _WITH_ALL_BELOW, _DETACH = 1 << 18, 1 << 14, 2  # MS_PRIVATE, MS_REC and MNT_DETACH of sys/mount.h
_LIBC = ctypes.CDLL(None, use_errno=True)
_owned = threading.Event()  # this process is in a user namespace of its own; set once, for good

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
        _unshare_as_the_same_user(_NETWORK)
        found = [os.open(f"/proc/self/ns/{name}", os.O_RDONLY) for name in ("user", "net")]
        socket.send_fds(tell, [b"!"], found)
    except OSError as error:
        tell.send(str(error.errno).encode())
    finally:
        os._exit(0)


def _unshare_as_the_same_user(kind: int) -> None:
    user, group = os.geteuid(), os.getegid()
    _check(_LIBC.unshare(_USER | kind))
    # Each number stands for itself, so that files seem to belong to whom they do. Groups need the first line.
    for name, text in (("setgroups", "deny"), ("uid_map", f"{user} {user} 1"), ("gid_map", f"{group} {group} 1")):
        Path("/proc/self", name).write_text(text)


def _unshare_for_good(kind: int) -> None:
    """Put this process into a new namespace; all of them belong to one user namespace of its own."""
    if _owned.is_set():
        _check(_LIBC.unshare(kind))  # another user namespace would have no right to change those of the first
    else:
        _unshare_as_the_same_user(kind)
        _owned.set()


def own_network() -> None:
    """Put this process, and those that it starts, into a network namespace of its own, without any link.

    It goes when the last process in it ends, however that ends. A further call puts only the calling thread, and what
    that starts, into another one; then the process may have more threads.

    Raises:
        OSError: if the system does not let this user make it, or the process has more than one thread.
    """
    _unshare_for_good(_NETWORK)


def further_network() -> int:
    """Return a descriptor of a further network namespace, without any link; this process stays where it is.

    The namespace goes when the descriptor is closed and no process is in it. Call `own_network` before.

    Raises:
        OSError: if the system does not let this user make it.
    """
    made: list[int | OSError] = []

    def make() -> None:
        try:
            _check(_LIBC.unshare(_NETWORK))  # of this thread alone
            made.append(os.open("/proc/thread-self/ns/net", os.O_RDONLY))
        except OSError as error:
            made.append(error)

    thread = threading.Thread(target=make, name="further network")
    thread.start()
    thread.join()
    if isinstance(made[0], OSError):
        raise made[0]
    return made[0]


def go_to_network(descriptor: int) -> None:
    """Put the calling thread, and all that it starts, into a network namespace; other threads stay where they are.

    Raises:
        OSError: if the system refuses.
    """
    _check(_LIBC.setns(descriptor, _NETWORK))


@contextlib.contextmanager
def own_disk(folder: Path, size: int) -> Iterator[None]:
    """Let this process, and those that it starts meanwhile, see a disk of their own at a folder.

    The process stays in its new namespaces at the end; only the disk goes.

    Args:
        folder: an empty folder.
        size: how much the disk holds, in bytes. It is in memory.

    Raises:
        OSError: if the system does not let this user make it, or the process has more than one thread.
    """
    _unshare_for_good(_MOUNTS)
    _check(_LIBC.mount(b"none", b"/", None, _PRIVATE | _WITH_ALL_BELOW, None))  # others must not see it
    _check(_LIBC.mount(b"tmpfs", os.fsencode(folder), b"tmpfs", 0, f"size={size},mode=700".encode()))
    try:
        yield
    finally:
        _check(_LIBC.umount2(os.fsencode(folder), _DETACH))


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
