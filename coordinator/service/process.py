"""The coordinator's process: it takes jobs from clients, stores them, has them run, and publishes their states.

Everything that matters is in the store: if the coordinator is killed at any moment, the next one continues from there.

No client waits for another client's slow request, or for all of its many. One thread answers questions. A few others
check submitted jobs, whose problems may be large. Both take the clients in turns, and give each a share of the time:
see `coordinator.service.fair_queue`. Changes of one job (updates and rewirings) are carried out one after another,
beside those of other jobs: see `coordinator.service.lanes`.
"""

import contextlib
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import zenoh

from coordinator.jobs.checkpoint import CHECKPOINT_EVERY
from coordinator.jobs.hooks import MakeJobRunner
from coordinator.jobs.running import EVAL_TIMEOUT
from coordinator.log_lines import LogLines
from coordinator.service.checking import Checker
from coordinator.service.fair_queue import FairQueue, Shares
from coordinator.service.host_book import HOST_TIMEOUT
from coordinator.service.lanes import Lanes
from coordinator.service.request_handler import RequestHandler
from coordinator.service.waiting_room import Queue, WaitingRoom
from coordinator.store.database import StoreFailed
from coordinator.store.job_store import Store
from coordinator.store.record_book import Keep, RecordBook
from coordinator.store.recorder import Recorder, log_record
from node.node_config import NodeConfig
from problems.modules import Modules
from wire import jobs, sessions
from wire.callbacks import direct
from wire.jobs import Answer, Done, Down, JobState, Refused, Request, Rewire, Submit, Update
from wire.keys import ANYONE, Keys
from wire.news import LogRecord
from wire.strict import Rejected

_SUBMITS_AT_ONCE, _OF_ONE_AT_ONCE = 8, 4  # a problem may take a hundred times its size in memory while it is checked
_SUBMITS = Queue("submits", 1000, 256 << 20)
_SUBMITS_OF_ONE, _BYTES_SUBMITTED = 250, 64 << 20  # of a client with a certificate, so that it leaves room for others
_MOST_WAITING, _BYTES_WAITING = 2000, 64 << 20  # requests of one client; further ones are dropped; clients ask again
_SHARES = Shares(alone=0.5, beside=0.1)  # of a client with a certificate, in questions, and again in submits
_CHANGES = Queue("changes", 1000, 256 << 20)
_CHANGES_OF_ONE, _BYTES_OF_ONE = 100, 64 << 20  # of one job, so that it leaves room for changes of others
_TRY_AGAIN = 0.5  # seconds between two attempts to open the database


@dataclass(frozen=True)
class Options:
    """How the service is started.

    Attributes:
        nodes: the number of nodes; if they join, the least number expected.
        store: the URL of the database.
        keep: how many records and ended jobs are kept there.
        log_json: whether the log is written as JSON; if None, it is if stderr is not a terminal.
        most_nodes: how many nodes may join; None for any number.
        eval_timeout: how many seconds an evaluation may go on once its job is stopped, if nodes join.
        checkpoint_every: seconds from one checkpoint of a job to the next; None for no checkpoints.
        host_timeout: how many seconds a host may stay away until it counts as gone, if nodes join.
        joined: whether router, spy and nodes were started separately, so that they stay when the coordinator ends.
        unprotected: endpoints of a network where whoever reaches them can use the cluster.
    """

    nodes: int
    store: str
    keep: Keep
    log_json: bool | None = None
    most_nodes: int | None = None
    eval_timeout: float = EVAL_TIMEOUT
    checkpoint_every: float | None = CHECKPOINT_EVERY
    host_timeout: float = HOST_TIMEOUT
    joined: bool = False
    unprotected: tuple[str, ...] = ()


def run(config: NodeConfig, options: Options, make_dispatcher: MakeJobRunner) -> None:
    """Run the coordinator until a client's `Down` or SIGTERM ends it."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    session = sessions.answering(config.router, config.identity)
    service = Service(session, config.keys, config.modules, options, make_dispatcher)
    signal.signal(signal.SIGTERM, lambda *_: service.stop())
    try:
        service.serve()
    finally:
        service.close()
        session.close()  # type: ignore[no-untyped-call]


class Service:
    """Receives requests through Zenoh and passes them to the request handler on suitable threads.

    Args:
        session: a Zenoh session through the router.
        keys: the key expressions of the cluster.
        modules: users' modules that may be run.
        options: how the service is started.
        make_dispatcher: makes the dispatcher.

    Raises:
        StoreFailed: if the database cannot be used.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        modules: Modules,
        options: Options,
        make_dispatcher: MakeJobRunner,
    ) -> None:
        self._session = session
        self._keys = keys
        self._mail: FairQueue[zenoh.Query] = FairQueue(_MOST_WAITING, _BYTES_WAITING, _SHARES, _has_a_certificate)
        self._waiting = WaitingRoom()
        self._down = threading.Event()
        self._submits: FairQueue[tuple[str, Callable[[], None]]] = FairQueue(
            _MOST_WAITING, shares=_SHARES, is_limited=_has_a_certificate, most_at_once=_OF_ONE_AT_ONCE
        )
        self._changes = Lanes()  # a lane for each job
        lines = LogLines(keys.cluster, options.log_json)
        self._store = _store_at(options.store, lines)
        self._states = session.declare_publisher(keys.state)
        book = RecordBook(self._store, options.keep)
        self._recorder = Recorder(self._store, book, lines, self._publish, self._forget)
        self._dispatcher = make_dispatcher(session, keys, options.nodes, self._recorder)
        checker = Checker(modules.allowed, modules.folder)
        self._request_handler = RequestHandler(
            keys.cluster,
            self._store,
            book,
            self._recorder,
            self._dispatcher,
            checker,
            self._publish,
            options.checkpoint_every,
            ends="coordinator" if options.joined else "cluster",
            unprotected=options.unprotected,
        )
        for endpoint in options.unprotected:
            text = f"whoever reaches {endpoint} can use, and misuse, this cluster: see docs/security.md"
            self._recorder.logged(log_record("warning", text))

    def serve(self) -> None:
        """Continue the jobs of the previous coordinator, then answer requests until `stop`."""
        self._request_handler.restore()
        self._dispatcher.restored()
        # The token last: a client that sees it may ask at once.
        queryable = self._session.declare_queryable(self._keys.any_request, direct(self._receive))
        token = self._session.liveliness().declare_token(self._keys.coordinator)
        worker = threading.Thread(target=self._work, name="requests", daemon=True)
        worker.start()
        for number in range(_SUBMITS_AT_ONCE):
            threading.Thread(target=self._submit, name=f"submits {number}", daemon=True).start()
        self._down.wait()
        with contextlib.suppress(zenoh.ZError):
            token.undeclare()  # type: ignore[no-untyped-call]
            queryable.undeclare()  # type: ignore[no-untyped-call]
        self._mail.close()
        worker.join()

    def stop(self) -> None:
        """Make `serve` return. Jobs that have not ended stay in the store for the next coordinator."""
        self._down.set()

    def close(self) -> None:
        """Close everything but the session."""
        self._submits.close()
        self._recorder.close()  # before the dispatcher: what happens to its jobs from now on must not be stored
        self._dispatcher.close()
        self._store.close()

    def _receive(self, query: zenoh.Query) -> None:
        """Queue a request; drop it if too many of its client wait. On Zenoh's thread."""
        client, _ = Keys.asker_of(str(query.key_expr))
        if not self._mail.put(client, query, 0 if query.payload is None else len(query.payload)):
            query.drop()  # type: ignore[no-untyped-call]

    def _submit(self) -> None:
        while (waiting := self._submits.take()) is not None:
            client, answer = waiting
            with self._submits.charged(client):
                answer()

    def _work(self) -> None:
        while (query := self._mail.take()) is not None:
            client, right = Keys.asker_of(str(query.key_expr))
            with self._mail.charged(client):
                try:
                    self._handle(query, client, right)
                except Exception as error:
                    self._fail(query, error)

    def _handle(self, query: zenoh.Query, client: str, right: str) -> None:
        """Answer a question at once; pass a submit or a change on to other threads. On the requests' thread."""
        try:
            request = jobs.decode(b"" if query.payload is None else query.payload.to_bytes())
        except Rejected as error:
            return self._reply(query, Refused(error.reason))
        if request.right != right:  # else a client with another right could send it
            return self._reply(query, Refused(f"{request.name} is asked for at .../{request.right}, not .../{right}"))
        if isinstance(request, Submit | Update | Rewire):
            self._put_off(query, request, client)
        else:
            self._answer(query, request, client)
        return None

    def _put_off(self, query: zenoh.Query, request: Submit | Update | Rewire, client: str) -> None:
        """Answer on another thread; refuse if too many requests wait for that already."""
        size = 0 if query.payload is None else len(query.payload)
        queues = _queues(request, client)
        full = self._waiting.enter(queues, size)
        if full is not None:
            refused = f"too many {full.name} wait (at most {full.requests}, {full.bytes >> 20} MiB in total); try later"
            return self._reply(query, Refused(refused, "failure"))
        leave = partial(self._waiting.leave, queues, size)
        answer = partial(self._answer_later, query, request, client, leave)
        if isinstance(request, Submit):
            self._submits.put(client, (client, answer))
        else:
            self._changes.put(request.job, answer)
        return None

    def _answer_later(self, query: zenoh.Query, request: Request, client: str, leave: Callable[[], None]) -> None:
        try:
            self._answer(query, request, client)
        except Exception as error:
            self._fail(query, error)
        finally:
            leave()

    def _fail(self, query: zenoh.Query, error: Exception) -> None:
        self._reply(query, Refused(f"{type(error).__name__}: {error}", "failure"))

    def _answer(self, query: zenoh.Query, request: Request, client: str) -> None:
        answer = self._request_handler.answer(request, client)
        self._reply(query, answer)
        if isinstance(request, Down) and isinstance(answer, Done):  # only now, so that the client gets its answer
            self.stop()

    def _reply(self, query: zenoh.Query, answer: Answer) -> None:
        """Answer under this cluster's key: that of the query may stand for any cluster."""
        key = self._keys.requests(*Keys.asker_of(str(query.key_expr)))
        with contextlib.suppress(zenoh.ZError), query:  # an error means that the client is gone
            query.reply(key, jobs.encode_answer(answer))

    def _publish(self, state: JobState) -> None:
        with contextlib.suppress(zenoh.ZError):  # clients can still ask for the state
            self._states.put(state.encode())

    def _forget(self, number: int) -> None:
        self._request_handler.forget(number)


def _has_a_certificate(client: str) -> bool:
    return client != ANYONE


def _queues(request: Submit | Update | Rewire, client: str) -> tuple[Queue, ...]:
    """Return the queues in which a client's request counts as waiting."""
    if isinstance(request, Submit):
        own = Queue(f"submits of {client}", _SUBMITS_OF_ONE, _BYTES_SUBMITTED)
        return (_SUBMITS,) if client == ANYONE else (_SUBMITS, own)
    return _CHANGES, Queue(f"changes of job {request.job!r}", _CHANGES_OF_ONE, _BYTES_OF_ONE)


def _store_at(url: str, lines: LogLines) -> Store:
    """Open the store; wait for a database that is away for a while."""
    waiting = False
    while True:
        try:
            return Store(url)
        except StoreFailed as error:
            if not error.passing:
                raise
            if not waiting:
                lines.write(LogRecord("warning", "coordinator", f"{error}; waiting for it", time.time()))
        waiting = True
        time.sleep(_TRY_AGAIN)
