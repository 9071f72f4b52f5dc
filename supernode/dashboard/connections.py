"""Limit the connections of each address, also of those that send nothing: the server has a most of all connections."""

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol

from supernode.dashboard.limits import subscriber

MOST = 400  # connections at once; requests beyond are refused
MOST_OF_ONE = 200  # connections at once of one address, so that none takes up all


class Connection(H11Protocol):
    """A connection, which is closed at once if its address has too many.

    Attributes:
        address: whose connection it is.
    """

    address = ""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Take the connection, or close it; the event loop calls this."""
        super().connection_made(transport)
        if self.client is None:  # it has gone already
            return
        self.address = subscriber(self.client[0])
        if sum(each.address == self.address for each in self.connections if isinstance(each, Connection)) > MOST_OF_ONE:
            transport.close()
