"""How a query of the coordinator or of a neighbour ends: with an answer, or without one."""

import zenoh

from wire import control


def answer(query: zenoh.Query, with_what: control.Answer) -> None:
    """Answer a query, which ends it."""
    reply(query, control.encode_answer(with_what))


def reply(query: zenoh.Query, payload: bytes) -> None:
    """Answer a query with an encoded answer, which ends it."""
    with query:
        query.reply(query.key_expr, payload)


def drop(query: zenoh.Query) -> None:
    """End a query without an answer: commands reach every node, and this one was meant for others."""
    query.drop()  # type: ignore[no-untyped-call]
