"""What each member of a cluster may send and receive, as rules for Zenoh's access control. All else is denied.

The router applies them to each link, and so do nodes to direct links from other hosts. Zenoh takes the member's name
from its certificate. It ignores rules unless ``enabled`` is set, and matches names literally.

The link over a private Unix socket has no certificate. Its folder's permissions let only one user in, who may do all.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from wire.keys import PREFIX
from wire.members import Member

_ALL = f"{PREFIX}/*"  # a router serves the clusters of all names
_LOCAL = "unixsock-stream"
_MESSAGES = (
    "put",
    "delete",
    "query",
    "reply",
    "declare_subscriber",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)


@dataclass(frozen=True)
class Traffic:
    """The key expressions that a member uses, by what it does with them.

    Attributes:
        publishes: it publishes under these.
        hears: it subscribes to these.
        asks: it sends queries to these.
        answers: it answers queries to these.
        is_asked: it gets queries to these too, such as those to many, and answers under a key of `answers`.
        lives: it holds liveliness tokens with these.
        watches: it watches for liveliness tokens with these.
    """

    publishes: tuple[str, ...] = ()
    hears: tuple[str, ...] = ()
    asks: tuple[str, ...] = ()
    answers: tuple[str, ...] = ()
    is_asked: tuple[str, ...] = ()
    lives: tuple[str, ...] = ()
    watches: tuple[str, ...] = ()


# What goes in at the end that applies the rules (comes from the member), and what goes out, for each kind of traffic.
_MESSAGES_OF: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "publishes": (("put",), ("declare_subscriber",)),
    "hears": (("declare_subscriber",), ("put",)),
    "asks": (("query",), ("reply", "declare_queryable")),
    "answers": (("declare_queryable", "reply"), ("query",)),
    "is_asked": ((), ("query",)),
    "lives": (("liveliness_token",), ("liveliness_query", "declare_liveliness_subscriber")),
    "watches": (("liveliness_query", "declare_liveliness_subscriber"), ("liveliness_token",)),
}


def traffic_of(member: Member) -> Traffic:
    """Return what a member may send and receive through the router."""
    return _TRAFFIC_OF[member.role](member)


def _of_the_coordinator(_: Member) -> Traffic:
    return Traffic(
        publishes=_each("state", "log"),
        hears=_each("best", "spy/stats", "spy/counters", "log"),
        asks=_each("node/*/control", "spy/control", "host/*"),
        answers=_each("jobs/*/*", "nodes"),
        lives=_each("coordinator"),
        watches=_each("node/*/life/*", "spy/life/*", "host/*"),
    )


def _of_the_spy(_: Member) -> Traffic:
    return Traffic(
        publishes=_each("best", "spy/stats", "spy/counters", "log"),
        hears=_each("node/*/out", "node/*/stats"),
        answers=_each("spy/control"),
        lives=_each("spy", "spy/life/*"),
        watches=_each("node/*", "node/*/routed"),
    )


def _of_a_host(member: Member) -> Traffic:
    """Return what the nodes of a host and its agent may do. The tokens that name a host must name this one."""
    here = f"$*.{member.name}"  # see `Identity.host_id`; no name has a full stop
    return Traffic(
        publishes=_each("node/*/out", "node/*/stats", "log"),
        hears=_each("node/*/out"),
        asks=_each("node/*/control", "nodes"),
        answers=_each("node/*/control", f"host/{here}"),
        is_asked=_each("host/*"),
        lives=_each("node/*", "node/*/routed", f"node/*/life/{here}", f"host/{here}"),
        watches=_each("coordinator", "node/*", "node/*/routed"),
    )


def _of_a_client(member: Member) -> Traffic:
    return Traffic(
        hears=_each("best", "state", "log", "spy/stats", "spy/counters"),
        asks=_each(*(f"jobs/{member.name}/{right}" for right in member.may)),
        watches=_each("coordinator", "node/*/life/*"),
    )


def _of_a_router(_: Member) -> Traffic:
    return Traffic()


_TRAFFIC_OF = {
    "coordinator": _of_the_coordinator,
    "spy": _of_the_spy,
    "node": _of_a_host,
    "client": _of_a_client,
    "dashboard": _of_a_client,
    "router": _of_a_router,
}


def _each(*keys: str) -> tuple[str, ...]:
    return tuple(f"{_ALL}/{key}" for key in keys)


def of_the_router(members: Iterable[Member]) -> dict[str, Any]:
    """Return the router's rules, Zenoh's setting ``access_control``."""
    return _rules({member.name: traffic_of(member) for member in members})


def of_links(cluster: str, nodes_of: Mapping[str, Iterable[int]]) -> dict[str, Any]:
    """Return the rules of a node for direct links from nodes of other hosts: each host speaks for its own nodes only.

    Args:
        cluster: the cluster's name.
        nodes_of: by the name of the host's member, the numbers of its nodes that are linked with this one.
    """
    node = f"{PREFIX}/{cluster}/node"
    return _rules(
        {
            member: Traffic(
                publishes=tuple(f"{node}/{each}/out" for each in nodes),
                hears=(f"{node}/*/out",),
                lives=tuple(f"{node}/{each}" for each in nodes),
                watches=(f"{node}/*",),
            )
            for member, nodes in nodes_of.items()
        }
    )


def _rules(traffic_of_each: Mapping[str, Traffic]) -> dict[str, Any]:
    rules: list[dict[str, Any]] = [_rule("local", ("ingress", "egress"), _MESSAGES, ("**",))]
    subjects: list[dict[str, Any]] = [{"id": "local", "link_protocols": [_LOCAL]}]
    policies: list[dict[str, Any]] = [{"rules": ["local"], "subjects": ["local"]}]
    for name, traffic in traffic_of_each.items():
        its = list(_rules_of(name, traffic))
        if its:
            rules += its
            subjects.append({"id": name, "cert_common_names": [name]})
            policies.append({"rules": [rule["id"] for rule in its], "subjects": [name]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules_of(name: str, traffic: Traffic) -> Iterable[dict[str, Any]]:
    for kind, (inwards, outwards) in _MESSAGES_OF.items():
        keys = getattr(traffic, kind)
        for way, messages in (("ingress", inwards), ("egress", outwards)):
            if keys and messages:
                yield _rule(f"{name} {kind}, {way}", (way,), messages, keys)


def _rule(id: str, flows: tuple[str, ...], messages: tuple[str, ...], keys: tuple[str, ...]) -> dict[str, Any]:
    return {"id": id, "permission": "allow", "flows": flows, "messages": messages, "key_exprs": keys}
