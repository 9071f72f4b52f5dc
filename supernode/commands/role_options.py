"""Options shared by the commands that run one process, or the processes of one host, of a distributed cluster.

Each option can also be set by an environment variable, since that is how containers are configured. The command line
wins.
"""

import argparse
import os
import signal
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from problems.modules import Modules

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
    add_option(parser, "connect", "the router's endpoint, such as tcp/192.168.1.7:7447", metavar="ENDPOINT")
    add_option(parser, "cluster", f"the cluster's name, if the router has several ({_CLUSTER})", default=_CLUSTER)


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add the options for the cluster's secret, and for the users' modules that the process may run."""
    file = "the cluster's secret, the same for coordinator, spy and nodes; made if missing (in the user's state folder)"
    add_option(parser, "secret-file", file, metavar="FILE")
    add_option(parser, "allow-module", "let jobs use problems from this module of yours (none)", metavar="M")


def secret_of(options: argparse.Namespace) -> bytes:
    """Return the cluster's secret.

    Raises:
        BadInput: if its file cannot be made or read, or holds no secret.
    """
    from pathlib import Path

    from supernode.client.cluster_info import default_folder
    from supernode.files.secret_file import read_or_make

    return read_or_make(Path(options.secret_file) if options.secret_file else default_folder() / "secret")


def modules_of(options: argparse.Namespace) -> "Modules":
    """Return the users' modules whose code the process may run."""
    from problems.modules import Modules

    return Modules((options.allow_module or "").split())


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
