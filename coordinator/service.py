"""The coordinator's process: takes jobs from clients, keeps them, has them run, and tells what becomes of them.

Its memory is the store: killed at any moment, the next one goes on where it stopped. Nobody waits for another's slow
request: questions are answered in the order of their coming on one thread; submits, whose problems may be large, on a
few others; and the changes of a job's world one after another, beside those of other jobs.
"""

import contextlib
import queue
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import zenoh

from coordinator.checking import Checker
from coordinator.database import StoreFailed
from coordinator.hooks import MakeDispatcher
from coordinator.lanes import Lanes
from coordinator.log_lines import LogLines
from coordinator.record_book import Keep, RecordBook
from coordinator.recorder import Recorder
from coordinator.request_handler import RequestHandler
from coordinator.store import Store
from coordinator.waiting_room import Queue, WaitingRoom
from node.node_config import NodeConfig
from problems.modules import Modules
from wire import jobs, sessions
from wire.callbacks import direct
from wire.jobs import Answer, Done, Down, JobState, Refused, Request, Rewire, Submit, Update
from wire.keys import Keys
from wire.news import LogRecord
from wire.strict import Rejected

_SUBMITS_AT_ONCE = 8  # each may take a hundred times its size in memory while it is checked
_SUBMITS = Queue("submits", 1000, 256 << 20)
_CHANGES = Queue("changes", 1000, 256 << 20)
_CHANGES_OF_ONE, _BYTES_OF_ONE = 100, 64 << 20  # job
_TRY_AGAIN = 0.5  # seconds


@dataclass(frozen=True)
class Options:
    """How the service is started.

    Attributes:
        nodes: how many there are.
        store: the URL of the database.
        keep: how much of what happened is kept there.
        log_json: whether the log is written in JSON; if None, it is where stderr is no terminal.
        joined: whether router, spy and nodes were started by others, and so live on when the coordinator ends.
    """

    nodes: int
    store: str
    keep: Keep
    log_json: bool | None = None
    joined: bool = False


def run(config: NodeConfig, options: Options, make_dispatcher: MakeDispatcher) -> None:
    """Be the coordinator until a client, or SIGTERM, says that the cluster is to end."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    session = sessions.client(config.router)
    service = Service(session, config.keys, config.modules, options, make_dispatcher)
    signal.signal(signal.SIGTERM, lambda *_: service.stop())
    try:
        service.serve()
    finally:
        service.close()
        session.close()  # type: ignore[no-untyped-call]


class Service:
    """The request handler with its telephone.

    Raises:
        StoreFailed: if the database cannot be used.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        modules: Modules,
        options: Options,
        make_dispatcher: MakeDispatcher,
    ) -> None:
        self._session = session
        self._keys = keys
        self._mail: queue.SimpleQueue[zenoh.Query | None] = queue.SimpleQueue()
        self._waiting = WaitingRoom()
        self._down = threading.Event()
        self._submits = ThreadPoolExecutor(_SUBMITS_AT_ONCE, "submits")
        self._changes = Lanes()  # by job
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
            ends="coordinator" if options.joined else "cluster",
        )

    def serve(self) -> None:
        """Go on with the jobs of the last coordinator, then answer requests until `stop`."""
        self._request_handler.restore()
        queryable = self._session.declare_queryable(self._keys.jobs, direct(self._mail.put))
        token = self._session.liveliness().declare_token(self._keys.coordinator)
        worker = threading.Thread(target=self._work, name="requests", daemon=True)
        worker.start()
        self._down.wait()
        with contextlib.suppress(zenoh.ZError):
            token.undeclare()  # type: ignore[no-untyped-call]
            queryable.undeclare()  # type: ignore[no-untyped-call]
        self._mail.put(None)
        worker.join()

    def stop(self) -> None:
        """Have `serve` return. Jobs that have not ended are kept for the next coordinator."""
        self._down.set()

    def close(self) -> None:
        """Let go of everything but the session."""
        self._submits.shutdown(wait=False, cancel_futures=True)
        self._recorder.close()  # first: what the end of the dispatcher does to jobs is none of theirs
        self._dispatcher.close()
        self._store.close()

    def _work(self) -> None:
        while (query := self._mail.get()) is not None:
            try:
                self._handle(query)
            except Exception as error:
                self._fail(query, error)

    def _handle(self, query: zenoh.Query) -> None:
        try:
            request = jobs.decode(b"" if query.payload is None else query.payload.to_bytes())
        except Rejected as error:
            return _reply(query, self._keys.jobs, Refused(error.reason))
        if isinstance(request, Submit | Update | Rewire):
            self._put_off(query, request)
        else:
            self._answer(query, request)
        return None

    def _put_off(self, query: zenoh.Query, request: Submit | Update | Rewire) -> None:
        """Answer on another thread, unless too many wait for that already."""
        size = 0 if query.payload is None else len(query.payload)
        full = self._waiting.enter(_queues(request), size)
        if full is not None:
            refused = (
                f"too many {full.name} wait already: at most {full.requests} may, of {full.bytes >> 20} MiB in all"
            )
            return _reply(query, self._keys.jobs, Refused(refused, "failure"))
        answer = partial(self._answer_later, query, request, size)
        if isinstance(request, Submit):
            self._submits.submit(answer)
        else:
            self._changes.put(request.job, answer)
        return None

    def _answer_later(self, query: zenoh.Query, request: Submit | Update | Rewire, size: int) -> None:
        try:
            self._answer(query, request)
        except Exception as error:
            self._fail(query, error)
        finally:
            self._waiting.leave(_queues(request), size)

    def _fail(self, query: zenoh.Query, error: Exception) -> None:
        _reply(query, self._keys.jobs, Refused(f"{type(error).__name__}: {error}", "failure"))

    def _answer(self, query: zenoh.Query, request: Request) -> None:
        answer = self._request_handler.answer(request)
        _reply(query, self._keys.jobs, answer)
        if isinstance(request, Down) and isinstance(answer, Done):
            self.stop()

    def _publish(self, state: JobState) -> None:
        with contextlib.suppress(zenoh.ZError):  # whoever wants to know can ask
            self._states.put(state.encode())

    def _forget(self, number: int) -> None:
        self._request_handler.forget(number)


def _queues(request: Submit | Update | Rewire) -> tuple[Queue, ...]:
    """Where it waits."""
    if isinstance(request, Submit):
        return (_SUBMITS,)
    return _CHANGES, Queue(f"changes of job {request.job!r}", _CHANGES_OF_ONE, _BYTES_OF_ONE)


def _store_at(url: str, lines: LogLines) -> Store:
    """The store; a database that is away for a while is waited for."""
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


def _reply(query: zenoh.Query, key: str, answer: Answer) -> None:
    with contextlib.suppress(zenoh.ZError), query:  # else the client is gone
        query.reply(key, jobs.encode_answer(answer))
