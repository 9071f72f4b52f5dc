"""The dashboard's web server: which requests there are, and what answers them."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator, Callable

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, Response

from coordinator.errors import ClusterFailed
from problems import BadInput
from supernode.client.cluster_info import Place
from supernode.dashboard import connections, data, login, pages
from supernode.dashboard.certificate import check_certificate
from supernode.dashboard.connections import Connection
from supernode.dashboard.credentials import Credentials
from supernode.dashboard.ending import CancellableApp, Server
from supernode.dashboard.guard import Guard
from supernode.dashboard.listen_address import ListenAddress
from supernode.dashboard.shared import Dashboard
from wire import jobs as wire

NICENESS = 5  # of the dashboard's process: nodes come first


def application(
    place: Place, single: bool, credentials: Credentials, broke: Callable[[BaseException], None]
) -> Starlette:
    """Return the ASGI application behind the guard.

    Args:
        place: where the cluster is.
        single: whether the cluster has one run and ends with it.
        credentials: who may log in.
        broke: called with an error that ends the background work: from then on all pages would be frozen.
    """

    def look_at(task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None:
            broke(error)

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        dashboard = app.state.dashboard = Dashboard(place)
        tasks = [asyncio.create_task(work.run()) for work in (dashboard.watcher, dashboard.streams)]
        for task in tasks:
            task.add_done_callback(look_at)
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        dashboard.scenes.close()

    return Starlette(
        routes=[*pages.routes(single), *login.routes(credentials), *data.routes()],
        exception_handlers={BadInput: _bad_input, ClusterFailed: _cluster_failed, HTTPException: _http},
        lifespan=lifespan,
    )


def serve(
    place: Place,
    listen_address: ListenAddress,
    sock: socket.socket,
    end: Callable[[uvicorn.Server], None] | None = None,
    single: bool = False,
) -> None:
    """Serve on ``sock`` until a signal; raise the error if the background work of the pages breaks.

    ``end`` receives the server before it runs, so that something other than a signal can end it.

    Raises:
        BadInput: if the certificate cannot be used.
    """
    if listen_address.certificate is not None and listen_address.key is not None:
        check_certificate(listen_address.certificate, listen_address.key)  # the files may have changed meanwhile
    broken: list[BaseException] = []

    def give_up(error: BaseException) -> None:
        broken.append(error)
        server.should_exit = True

    credentials = Credentials(listen_address.tokens, listen_address.session_key)
    app = CancellableApp(Guard(application(place, single, credentials, give_up), listen_address, credentials))
    config = uvicorn.Config(
        app,
        log_level="error",
        access_log=False,
        server_header=False,
        http=Connection,
        limit_concurrency=connections.MOST,
        timeout_graceful_shutdown=1,
        ws="none",
        proxy_headers=False,
        ssl_certfile=listen_address.certificate,
        ssl_keyfile=listen_address.key,
        ssl_ciphers=None,  # Python's own choice; uvicorn's was weaker
    )
    server = Server(app, config)
    if end is not None:
        end(server)
    server.run(sockets=[sock])
    if broken:
        raise broken[0]


# Errors ---------------------------------------------------------------------------------------------------------------
def _refusal(text: str, status: int) -> Response:
    return JSONResponse({"error": wire.encodable(text)}, status)


async def _bad_input(_: Request, error: Exception) -> Response:
    return _refusal(str(error), 400)


async def _cluster_failed(_: Request, error: Exception) -> Response:
    return _refusal(str(error), 503)


async def _http(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return _refusal(error.detail, error.status_code)
