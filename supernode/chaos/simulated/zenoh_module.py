"""A stand-in for the module `zenoh`, with the part of its interface that is used, and for `wire.sessions`."""

import types

from supernode.chaos.simulated.network import Network
from supernode.chaos.simulated.samples import Answer, Bytes, Callback, Publisher, Query, Sample, SampleKind, ZError
from supernode.chaos.simulated.sessions import DECLARE, Session
from supernode.chaos.simulated.world import Process
from wire.sessions import unix_socket

_OPENED_WITHIN = 60.0  # seconds


class Zenoh:
    """Makes the stand-in for the module `zenoh` in one network."""

    def __init__(self, network: Network) -> None:
        self._network = network
        self.module = types.SimpleNamespace(
            Session=Session,
            Query=Query,
            Sample=Sample,
            Reply=Answer,
            SampleKind=SampleKind,
            ZError=ZError,
            ZBytes=Bytes,
            Publisher=Publisher,
            Priority=types.SimpleNamespace(DATA="data"),
            QueryTarget=types.SimpleNamespace(ALL="all"),
            ConsolidationMode=types.SimpleNamespace(NONE="none"),
            handlers=types.SimpleNamespace(Callback=Callback),
        )
        self.sessions = types.SimpleNamespace(
            client=self.client,
            peer=self.peer,
            unix_socket=unix_socket,
            use_runtime=lambda _: None,
            NODE_RUNTIME="",
            LONG_ANSWER="data_low",
        )

    def _process(self) -> Process:
        process = self._network.world.process
        assert process is not None, "only a process opens sessions"
        return process

    def client(self, endpoint: str, identity: None = None) -> Session:
        """Instead of `wire.sessions.client`; nobody shows certificates here."""
        world = self._network.world
        session = Session(self._network, self._process(), [], [endpoint])
        until = world.now + _OPENED_WITHIN
        while not session.links and world.now < until:
            world.sleep(1e-3)
        return session

    def peer(self, listen: list[str], links: list[str], identity: None = None, access: None = None) -> Session:
        """Instead of `wire.sessions.peer`; nobody shows certificates here."""
        session = Session(self._network, self._process(), listen, links, is_peer=True)
        self._network.world.spend(DECLARE)
        return session
