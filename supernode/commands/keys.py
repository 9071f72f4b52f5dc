"""Make, list, renew and revoke the keys of a cluster: who may do what, proved by certificates on every link.

`init` makes an authority in a folder, and keys for each role. Give each machine the folders of its own members only.
The folder itself, with routers.key and members.key, is for who admits further members.
"""

import argparse
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.run_options import positive

if TYPE_CHECKING:
    from supernode.files.authority import Authority

EXAMPLE = "supernode keys init keys"

_DAYS = 365.0
_ROLES = ("client", "node", "dashboard", "router", "coordinator", "spy")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the action and what it is about."""
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    init = actions.add_parser("init", help="make an authority, and keys for each role")
    add = actions.add_parser("add", help="make keys for one more member")
    listing = actions.add_parser("list", help="list the members")
    renew = actions.add_parser("renew", help="make the keys of members anew, under the same names")
    revoke = actions.add_parser("revoke", help="let a member do nothing any more")
    for each in (init, add, listing, renew, revoke):
        each.add_argument("folder", metavar="DIR", help="the authority's folder")
    add.add_argument("role", metavar="ROLE", choices=_ROLES, help=", ".join(_ROLES))
    for each in (add, revoke):
        each.add_argument("name", metavar="NAME", help="the member's name")
    renew.add_argument("names", metavar="NAME", nargs="*", help="the members (all)")
    add.add_argument(
        "--may",
        metavar="RIGHTS",
        help="what a client or a dashboard may do, some of watch,submit,change,down (watch,submit)",
    )
    for each in (init, add):
        each.add_argument("--days", metavar="D", type=positive, default=_DAYS, help="how long they are valid (365)")
    renew.add_argument("--days", metavar="D", type=positive, help="how long they are valid (as long as those before)")
    for each in (init, add):
        each.add_argument(
            "--address",
            metavar="A",
            action="append",
            default=[],
            help="a name or an address at which others reach the router, or the host of nodes (this machine's)",
        )


def run(options: argparse.Namespace) -> int:
    """Carry out the action."""
    from importlib.util import find_spec
    from pathlib import Path

    from problems.errors import BadInput

    if find_spec("cryptography") is None:
        raise BadInput("keys: expected cryptography to be installed: pip install 'supernode[keys]'")
    from supernode.files.authority import Authority, locked

    folder = Path(options.folder)
    if options.action == "init":
        _init(Authority.make(folder), options)
        return exits.OK
    with locked(folder):
        _act(Authority(folder), options)
    return exits.OK


def _act(authority: "Authority", options: argparse.Namespace) -> None:
    if options.action == "list":
        _print_list(authority)
    elif options.action == "add":
        _add(authority, options)
    elif options.action == "renew":
        for name in options.names or list(authority.members):
            print(f"renewed {name}, until {authority.renew(name, options.days).expires}")
        print("The router takes its new keys at once. The others take theirs with their next link.")
    else:
        authority.revoke(options.name)
        print(f"revoked {options.name}; a router in another place needs the new {authority.folder}/router/members.json")


def _init(authority: "Authority", options: argparse.Namespace) -> None:
    from supernode.files.authority import own_names
    from wire.jobs import CHANGE, RIGHTS, SUBMIT, WATCH

    addresses = tuple(options.address) or own_names()
    for role, may in (
        ("router", ()),
        ("coordinator", ()),
        ("spy", ()),
        ("node", ()),
        ("client", RIGHTS),
        ("dashboard", (WATCH, SUBMIT, CHANGE)),
    ):
        authority.add(role, role, may, options.days, addresses if role in ("router", "node") else ())
    print(f"made {authority.folder}, with keys for {', '.join(authority.members)}, for {', '.join(addresses)}")


def _add(authority: "Authority", options: argparse.Namespace) -> None:
    from problems.errors import BadInput
    from supernode.files.authority import own_names
    from wire.jobs import RIGHTS

    may: tuple[str, ...] = ()
    if options.role in ("client", "dashboard"):
        may = tuple((options.may or "watch,submit").split(","))
        if not set(may) <= set(RIGHTS):
            raise BadInput(f"--may: expected some of {','.join(RIGHTS)}, found {options.may}")
    elif options.may is not None:
        raise BadInput(f"--may: expected it for a client or a dashboard only, found it for a {options.role}")
    listens = options.role in ("router", "node")
    addresses = (tuple(options.address) or own_names()) if listens else ()
    member = authority.add(options.name, options.role, may, options.days, addresses)
    print(f"made {authority.folder / member.name}, valid until {member.expires}")


def _print_list(authority: "Authority") -> None:
    from datetime import UTC, datetime

    from rich.console import Console
    from rich.table import Table

    table = Table("name", "role", "may", "valid until", "at", box=None)
    for member in authority.members.values():
        expired = datetime.fromisoformat(member.expires) < datetime.now(UTC)
        until = member.expires[:10] + (" (expired)" if expired else "")
        table.add_row(member.name, member.role, ", ".join(member.may), until, ", ".join(member.addresses))
    Console().print(table)
