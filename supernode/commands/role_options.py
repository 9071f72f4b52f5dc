"""Options shared by the commands that run one process, or the processes of one host, of a distributed cluster.

Each option can also be set by an environment variable, since that is how containers are configured. The command line
wins.
"""

import argparse
import os
import signal
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from supernode.commands.cluster_options import add_keys

if TYPE_CHECKING:
    from problems.modules import Modules
    from wire.members import Identity

_CLUSTER = "main"  # a router has one cluster unless several are named, so most need no name


def add_option(parser: argparse.ArgumentParser, name: str, words: str, **more: Any) -> None:
    """Add an option ``--name`` whose default is the environment variable SUPERNODE_NAME."""
    variable = variable_of(name)
    default = os.environ.get(variable) or more.pop("default", None)
    parser.add_argument(f"--{name}", default=default, help=f"{words} [{variable}]", **more)


def add_log_json(parser: argparse.ArgumentParser) -> None:
    """Add the option that chooses the format of the log."""
    parser.add_argument(
        "--log-json", action="store_true", default=None, help="write the log to stderr as JSON Lines, on a terminal too"
    )


def variable_of(name: str) -> str:
    """Return the environment variable of an option."""
    return f"SUPERNODE_{name.upper().replace('-', '_')}"


def add_membership(parser: argparse.ArgumentParser) -> None:
    """Add the options that name the cluster of the process."""
    add_option(parser, "connect", "the router's endpoint, such as tls/192.168.1.7:7447", metavar="ENDPOINT")
    add_keys(parser)
    add_option(parser, "cluster", f"the cluster's name, if the router has several ({_CLUSTER})", default=_CLUSTER)


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add the options for the cluster's secret, and for the users' modules that the process may run."""
    file = "the cluster's secret, the same for coordinator, spy and nodes; made if missing (the keys', else the user's)"
    add_option(parser, "secret-file", file, metavar="FILE")
    add_option(parser, "allow-module", "let jobs use problems from this module of yours (none)", metavar="M")


def secret_of(options: argparse.Namespace, identity: "Identity | None") -> bytes:
    """Return the cluster's secret: from the file that is named, else that of the keys, else the user's.

    Raises:
        BadInput: if its file cannot be made or read, or holds no secret.
    """
    from pathlib import Path

    from supernode.client.cluster_info import default_folder
    from supernode.files.key_folder import secret_in
    from supernode.files.secret_file import read_or_make

    if identity is not None and not options.secret_file:
        return secret_in(identity)
    return read_or_make(Path(options.secret_file) if options.secret_file else default_folder() / "secret")


def modules_of(options: argparse.Namespace) -> "Modules":
    """Return the users' modules whose code the process may run."""
    from problems.modules import Modules

    return Modules((options.allow_module or "").split())


def add_insecure(parser: "argparse._ActionsContainer") -> None:
    """Add the option that lets a process listen without keys."""
    parser.add_argument(
        "--insecure",
        action="store_true",
        default=bool(os.environ.get("SUPERNODE_INSECURE")),
        help="listen at plain endpoints of a network: whoever reaches them can use, and misuse, the cluster"
        " [SUPERNODE_INSECURE]",
    )


def check_listen(endpoints: Iterable[str], has_keys: bool, insecure: bool) -> None:
    """Check that strangers cannot use what listens at these endpoints, unless the user allows it.

    Raises:
        BadInput: if an endpoint does not fit the keys, or needs some.
    """
    from problems.errors import BadInput
    from wire.sessions import UNIX_SOCKET, is_encrypted, is_plain_abroad

    for each in endpoints:
        if is_encrypted(each) and not has_keys:
            raise BadInput(f"--listen: {each}: expected --keys DIR too; `supernode keys init DIR` makes keys")
        if has_keys and not is_encrypted(each) and not each.startswith(UNIX_SOCKET):
            raise BadInput(f"--listen: expected tls/ADDRESS:PORT or quic/ADDRESS:PORT with --keys, found {each}")
        if not has_keys and not insecure and is_plain_abroad(each):
            raise BadInput(
                f"--listen: {each}: whoever reaches it could use the cluster; expected tls/ADDRESS:PORT with --keys DIR"
                " (`supernode keys init DIR` makes keys), or --insecure in a network of trusted people alone"
            )


def endpoint_of(options: argparse.Namespace, name: str = "connect") -> str:
    """Return the endpoint that an option must give.

    Raises:
        BadInput: if the option is not given, or not an endpoint.
    """
    return endpoint(_needed(options, name), name)


def endpoint(text: str, name: str) -> str:
    """Return ``text`` if it is an endpoint.

    Args:
        text: the value of the option.
        name: the option's name, for the error.

    Raises:
        BadInput: if it is not an endpoint.
    """
    from supernode.client.cluster_info import Place

    found = Place.at(text, f"--{name}").endpoint
    assert found is not None, "that is what it was made of"
    return found


def number_of(options: argparse.Namespace, name: str, least: int = 1) -> int:
    """Return the whole number, at least ``least``, that an option must give.

    Raises:
        BadInput: if the option is not given, or not such a number.
    """
    from problems.errors import BadInput

    text = _needed(options, name)
    if not text.isascii() or not text.isdigit() or int(text) < least:
        raise BadInput(f"--{name.replace('_', '-')}: expected a whole number, at least {least}, found {text}")
    return int(text)


def cluster_of(options: argparse.Namespace) -> str:
    """Return the cluster's name, a part of every key expression.

    Raises:
        BadInput: if it has characters that a key expression could not hold.
    """
    import re

    from problems.errors import BadInput

    if not re.fullmatch(r"[A-Za-z0-9._-]{1,64}", options.cluster):
        raise BadInput(f"--cluster: expected letters, digits, '.', '_' or '-', found {options.cluster}")
    return str(options.cluster)


def prepare_process() -> None:
    """Limit libraries to one thread, and let SIGTERM and SIGHUP end the process.

    Call this before numpy is imported. The handlers are needed in a container: its first process ignores signals that
    it has no handler for.
    """
    from coordinator.threads import ONE_THREAD

    os.environ.update(ONE_THREAD)
    for kind in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(kind, lambda *_: os._exit(0))


def _needed(options: argparse.Namespace, name: str) -> str:
    from problems.errors import BadInput

    value = getattr(options, name)
    if not value:
        raise BadInput(f"--{name.replace('_', '-')}: needed, since {variable_of(name)} is not set")
    return str(value)
