"""A client of a simulated cluster: it submits jobs, hears their improvements, and waits for their ends."""

import json
from dataclasses import dataclass, field
from typing import Any

from coordinator.jobs.states import ENDS
from problems import ProblemFile
from supernode.chaos.simulated.network import Network
from supernode.chaos.simulated.samples import Callback, Sample
from supernode.chaos.simulated.world import EPOCH, Process, World
from supernode.chaos.simulated.zenoh_module import Zenoh
from wire.jobs import Cancel, Done, Request, Show, Submit, Update, decode_answer, encode
from wire.keys import ANYONE, Keys
from wire.news import Improvement

_ANSWER_WITHIN = 5.0  # seconds, then a request is sent again
_AGAIN = 0.1  # seconds between two attempts
_LOOK_EVERY = 0.5  # seconds between two looks at a job


@dataclass
class Asked:
    """A job as its client sees it.

    Attributes:
        id: the job's id.
        file: the problem.
        number: the number that the coordinator gave it; None before it has told.
        accepted: whether the coordinator has said that it has the job.
        refused: why it was refused, or why nothing is known of it any more.
        told: the improvements that the client was told before the end, each with its Unix time, in their order.
        status: its latest known state.
        message: what was said about that state.
        result: its result, as plain values.
        ended_at: when the client knew that it had ended, in seconds of the world.
        changed: the changes that were answered with the number of an epoch: "rewire" and "update".
    """

    id: str
    file: ProblemFile
    number: int | None = None
    accepted: bool = False
    refused: str | None = None
    told: list[tuple[float, Improvement]] = field(default_factory=list)
    status: str = "unknown"
    message: str | None = None
    result: dict[str, Any] | None = None
    ended_at: float | None = None
    changed: set[str] = field(default_factory=set)

    @property
    def has_ended(self) -> bool:
        """Whether the client knows the end of the job."""
        return self.ended_at is not None or self.refused is not None


class SimulatedClient:
    """A client with one session.

    Args:
        world: the world that it lives in.
        network: its network.
        router: the endpoint of the cluster's router.
        keys: the cluster's key expressions.
    """

    def __init__(self, world: World, network: Network, router: str, keys: Keys) -> None:
        self.process = Process(world, "client")
        self.jobs: list[Asked] = []
        self._world = world
        self._zenoh = Zenoh(network)
        self._router = router
        self._keys = keys

    def submit(self, id: str, file: ProblemFile) -> None:
        """Submit a job on a thread of its own, and follow it to its end."""
        asked = Asked(id, file)
        self.jobs.append(asked)
        self.process.start(lambda: self._follow(asked), f"job {id}")

    def ask(self, id: str, request: Request) -> None:
        """Send a request about a job on a thread of its own, until it is answered."""
        self.process.start(lambda: self._tell(id, request), request.name)

    def _tell(self, id: str, request: Request) -> None:
        session = self._session()
        if isinstance(request, Cancel):  # some jobs end only so; those that nobody knows yet cannot be cancelled
            while not any(asked.id == id and (asked.accepted or asked.refused) for asked in self.jobs):
                self._world.sleep(_AGAIN)
        answer = self._ask(session, request)
        if isinstance(answer, Done) and not isinstance(request, Cancel):
            asked = next(asked for asked in self.jobs if asked.id == id)
            if not _may_change_nothing(asked.file, request):
                asked.changed.add(request.name)
        self._world.say(f"client: {request.name} of {id} is answered: {answer}")

    def _session(self) -> Any:
        return self._zenoh.sessions.client(self._router)

    def _follow(self, asked: Asked) -> None:
        session = self._session()
        session.declare_subscriber(self._keys.best, Callback(lambda sample: self._hear(asked, sample)))
        answer = self._ask(session, Submit(asked.file.to_json(), asked.id))
        if not isinstance(answer, Done):
            asked.refused = answer.message
            return
        asked.accepted = True
        self._world.say(f"client: {asked.id} is accepted")
        while asked.ended_at is None:
            self._look(session, asked)
            self._world.sleep(_LOOK_EVERY)

    def _look(self, session: Any, asked: Asked) -> None:
        answer = self._ask(session, Show(asked.id, brief=True))
        if not isinstance(answer, Done):
            asked.refused = answer.message
            asked.ended_at = self._world.now
            return
        shown = answer.value
        if shown["status"] != asked.status:
            asked.status = shown["status"]
            self._world.say(f"client: {asked.id} is {asked.status}")
        asked.number, asked.message = shown["number"], shown["message"]
        draining = asked.status == "deadline" and shown.get("result") is None and shown.get("ended") is None
        if asked.status in ENDS and not draining:
            asked.result = shown.get("result")
            asked.ended_at = self._world.now
            # A spy that was stopped may tell its last answers between the job's end and this question.
            asked.told = [(at, each) for at, each in asked.told if shown["ended"] is None or at < shown["ended"]]

    def _hear(self, asked: Asked, sample: Sample) -> None:
        if asked.ended_at is None:
            asked.told.append((EPOCH + self._world.now, Improvement.decode(sample.payload.to_bytes())))

    def _ask(self, session: Any, request: Request) -> Any:
        """Send a request until it is answered; return the answer."""
        key = self._keys.requests(ANYONE, request.right)
        while True:
            for reply in session.get(key, payload=encode(request), timeout=_ANSWER_WITHIN):
                if reply.ok is not None:
                    answer = decode_answer(reply.ok.payload.to_bytes())
                    if isinstance(answer, Done) or answer.blame == "input":  # else it may work later
                        return answer
            self._world.sleep(_AGAIN)


def _may_change_nothing(file: ProblemFile, request: Request) -> bool:
    """Return whether a request is an update to what the job was submitted with, which may be what it has."""
    return isinstance(request, Update) and json.loads(request.patch).items() <= file.fields.items()
