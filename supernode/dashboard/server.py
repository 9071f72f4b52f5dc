"""The dashboard's web server: pages, what their scripts ask for, live news, metrics."""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.templating import Jinja2Templates

from coordinator.errors import ClusterFailed
from problems import BadInput
from problems.file import parse
from problems.registry import find_built_in, kinds
from supernode.client import AsyncClientJob
from supernode.dashboard.door import Door
from supernode.dashboard.guard import Guard
from supernode.dashboard.metrics import Metrics
from supernode.dashboard.scenes import Form, Scenes
from supernode.dashboard.streams import Streams
from supernode.dashboard.view import View, shape_of
from supernode.dashboard.watcher import PATIENCE, Watcher
from supernode.whereabouts import Place
from wire import jobs as wire

MOST_BODY = wire.MOST_FILE_BYTES  # bytes
_MOST_CONNECTIONS = 400
_HERE = Path(__file__).parent
_NOWHERE = Path("/nonexistent")  # a problem from a form names no files, neither here nor on the cluster's machine
_FRESH = 0.5  # seconds that an answer of the cluster is shared by all who ask the same
_KEPT = 256  # such answers


class Dashboard:
    """One cluster's dashboard: what its requests share."""

    def __init__(self, place: Place) -> None:
        self.view = View()
        self.watcher = Watcher(place, self.view)
        self.streams = Streams(self.view.snapshot)
        self.scenes = Scenes()
        self.metrics = Metrics(self.view)
        self._answers: dict[wire.Request, tuple[float, asyncio.Task[Any]]] = {}

    async def ask(self, request: wire.Request) -> Any:
        """The cluster's answer, at most half a second old: many who watch the same job cost no more than one."""
        now = asyncio.get_running_loop().time()
        asked, answer = self._answers.get(request, (-_FRESH, None))
        if answer is None or now - asked >= _FRESH:
            self._answers = {key: each for key, each in self._answers.items() if now - each[0] < _FRESH}
            if len(self._answers) >= _KEPT:
                raise ClusterFailed("too many questions at once")
            answer = asyncio.create_task(self.watcher.client.ask(request, PATIENCE))
            self._answers[request] = (now, answer)
        return await asyncio.shield(answer)


def application(place: Place, door: Door, single: bool = False) -> Starlette:
    """The whole of it as an ASGI application; ``single``: of a cluster that has one run and ends with it."""

    @contextlib.asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        dashboard = app.state.dashboard = Dashboard(place)
        tasks = [asyncio.create_task(dashboard.watcher.run()), asyncio.create_task(dashboard.streams.run())]
        yield
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        dashboard.scenes.close()

    return Starlette(
        routes=_routes(single),
        middleware=[Middleware(Guard, door=door)],
        exception_handlers={BadInput: _bad_input, ClusterFailed: _cluster_failed, HTTPException: _http},
        lifespan=lifespan,
    )


def serve(
    place: Place,
    door: Door,
    sock: socket.socket,
    end: Callable[[uvicorn.Server], None] | None = None,
    single: bool = False,
) -> None:
    """Serve on ``sock`` until a signal; ``end`` gets the server before it runs, for whoever else may end it."""
    config = uvicorn.Config(
        application(place, door, single),
        log_level="error",
        access_log=False,
        server_header=False,
        limit_concurrency=_MOST_CONNECTIONS,
        timeout_graceful_shutdown=1,
        ws="none",
        proxy_headers=False,
    )
    server = uvicorn.Server(config)
    if end is not None:
        end(server)
    server.run(sockets=[sock])


def _routes(single: bool) -> list[Route | Mount]:
    return [
        Route("/", _page("cluster.html", single)),
        Route("/jobs", _page("jobs.html", single)),
        Route("/jobs/{job}", _page("job.html", single)),
        Route("/compare", _page("compare.html", single)),
        Route("/events", _Events()),
        Route("/metrics", _metrics),
        Route("/healthz", _healthz),
        Route("/jobs/{job}/scene.png", _scene("png", "image/png")),
        Route("/api/nodes/{node:int}", _node),
        Route("/api/templates/{kind}", _template),
        Route("/api/jobs", _submit, methods=["POST"]),
        Route("/api/jobs/{job}", _job),
        Route("/api/jobs/{job}/history", _history),
        Route("/api/jobs/{job}/spaces", _scene("spaces", "application/json")),
        Route("/api/jobs/{job}/cancel", _cancel, methods=["POST"]),
        Route("/static/plotly.min.js", _plotly),
        Mount("/static", StaticFiles(directory=_HERE / "static")),
    ]


def _of(request: Request) -> Dashboard:
    dashboard: Dashboard = request.app.state.dashboard
    return dashboard


# Pages ----------------------------------------------------------------------------------------------------------------
_templates = Jinja2Templates(_HERE / "templates")


def _page(name: str, single: bool) -> Callable[[Request], Awaitable[Response]]:
    async def page(request: Request) -> Response:
        told = {"job": request.path_params.get("job"), "kinds": kinds(), "single": single}
        return _templates.TemplateResponse(request, name, told)

    return page


async def _plotly(_: Request) -> Response:
    path = str(files("plotly") / "package_data" / "plotly.min.js")
    return FileResponse(path, headers={"Cache-Control": "private, max-age=86400"})


class _Events:
    """The streams, which begin with the application."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        await scope["app"].state.dashboard.streams(scope, receive, send)


# What scripts ask for -------------------------------------------------------------------------------------------------
async def _node(request: Request) -> Response:
    found = _of(request).view.node(request.path_params["node"])
    if found is None:
        raise BadInput(f"there is no node {request.path_params['node']}")
    return JSONResponse(found)


async def _template(request: Request) -> Response:
    kind = await asyncio.to_thread(find_built_in, request.path_params["kind"])  # its import takes a second
    return PlainTextResponse(kind.template)


async def _job(request: Request) -> Response:
    view = await _of(request).ask(wire.Show(request.path_params["job"]))
    name, fields, run, _ = json.loads(view["file_now"])
    rows, columns = shape_of(view["topology"])
    told = {key: value for key, value in view.items() if key not in ("file", "file_now", "worlds")}
    told |= {"name": name, "problem": _short(fields), "run": run, "rows": rows, "columns": columns}
    return JSONResponse(told)


async def _history(request: Request) -> Response:
    """What happened in a job after the records that the page has already."""
    job, pages = request.path_params["job"], {}
    for kind in ("improvements", "statistics"):
        after = _whole(request.query_params.get(kind, "0"), kind)
        pages[kind] = await _of(request).ask(wire.Records(kind, job, after))
    return JSONResponse(pages)


def _scene(form: Form, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    async def scene(request: Request) -> Response:
        dashboard = _of(request)
        view = await dashboard.ask(wire.Show(request.path_params["job"]))
        return Response(await dashboard.scenes.drawn(view, form), media_type=media_type)

    return scene


async def _submit(request: Request) -> Response:
    """A problem file's text, and settings that replace those in it; empty ones do not."""
    given = await _given(request)
    text, name = given.pop("file", None), given.pop("name", None) or "form.toml"
    job, priority = given.pop("id", None) or None, _whole(given.pop("priority", None) or 0, "priority")
    if not isinstance(text, str) or not isinstance(name, str) or not (job is None or isinstance(job, str)):
        raise BadInput("file, name, id: expected texts")
    file = parse(text, name, _NOWHERE).with_run(**_settings(given))
    handed_in = await _of(request).watcher.client.submit(file, id=job, priority=priority)
    return JSONResponse({"job": handed_in.id}, 201)


def _settings(given: Mapping[str, Any]) -> dict[str, Any]:
    unknown = given.keys() - {"seed", "seconds"}
    if unknown:
        raise BadInput(f"expected file, name, id, priority, seed and seconds, found {', '.join(sorted(unknown))}")
    settings: dict[str, Any] = {}
    if given.get("seed") not in (None, ""):
        settings["seed"] = _whole(given["seed"], "seed")
    if given.get("seconds") not in (None, ""):
        try:
            settings["seconds"] = float(given["seconds"])
        except (TypeError, ValueError):
            raise BadInput("seconds: expected a number") from None
    return settings


async def _cancel(request: Request) -> Response:
    job: AsyncClientJob = await _of(request).watcher.client.job(request.path_params["job"])
    return JSONResponse({"job": job.id, "status": await job.cancel()})


async def _given(request: Request) -> dict[str, Any]:
    """The fields of a form, or of a JSON object."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    body = await _body(request)
    try:
        if kind == "application/x-www-form-urlencoded":
            return dict(parse_qsl(body.decode(), keep_blank_values=True, strict_parsing=True, max_num_fields=16))
        if kind != "application/json":
            raise HTTPException(415, "expected JSON or a form")
        given = json.loads(body)
    except (ValueError, RecursionError) as error:
        raise BadInput("expected a JSON object or a form, found something else") from error
    if not isinstance(given, dict):
        raise BadInput("expected a JSON object, found something else")
    return given


async def _body(request: Request) -> bytes:
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > MOST_BODY:
            raise HTTPException(413, f"expected at most {MOST_BODY} bytes")
    return bytes(body)


def _whole(text: Any, name: str) -> int:
    try:
        return int(text)
    except (TypeError, ValueError):
        raise BadInput(f"{name}: expected a whole number") from None


def _short(fields: Mapping[str, Any]) -> dict[str, Any]:
    """The problem's fields, without whole maps and meshes."""
    return {name: value for name, value in fields.items() if len(json.dumps(value)) <= 200}


# For machines ---------------------------------------------------------------------------------------------------------
async def _metrics(request: Request) -> Response:
    return PlainTextResponse(_of(request).metrics.text(), media_type="text/plain; version=0.0.4")


async def _healthz(request: Request) -> Response:
    await _of(request).ask(wire.ListJobs(0))
    return PlainTextResponse("the cluster answers\n")


# What goes wrong ------------------------------------------------------------------------------------------------------
async def _bad_input(_: Request, error: Exception) -> Response:
    return JSONResponse({"error": str(error)}, 400)


async def _cluster_failed(request: Request, error: Exception) -> Response:
    if request.url.path == "/healthz":
        return PlainTextResponse(f"{error}\n", 503)
    return JSONResponse({"error": str(error)}, 503)


async def _http(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    return JSONResponse({"error": error.detail}, error.status_code)
