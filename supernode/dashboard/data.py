"""The data that the pages' scripts, Prometheus and health checks ask for, and what scripts may have done."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from functools import lru_cache
from typing import Any

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from problems import BadInput, ProblemFile
from problems.errors import shorten
from problems.registry import find_built_in
from supernode.client.async_job import AsyncClientJob
from supernode.dashboard.fields import as_number, as_whole, fields_of, text_of
from supernode.dashboard.packing import answer_of
from supernode.dashboard.scenes import Form
from supernode.dashboard.shared import dashboard_of
from supernode.live.view import shape_of, wraps
from wire import jobs as wire

_MOST_BODY = wire.MOST_FILE_BYTES
_MOST_NAME = 200  # characters
_MOST_SEED = (1 << 64) - 1
_MOST_RECORD = 1 << 62
_FIELDS = ("file", "name", "id", "priority", "seed", "seconds")  # of the form that submits a job
_MADE = 8  # parsed problem files that are kept
_SHORT = 200  # characters of JSON; longer fields of a problem are not sent to pages


def routes() -> list[Route]:
    """Return the routes of data, live updates and actions."""
    return [
        Route("/events", _Events(), methods=["GET"]),
        Route("/metrics", _metrics),
        Route("/healthz", _healthz),
        Route("/jobs/{job}/scene.png", _scene("png", "image/png")),
        Route("/api/nodes/{node:int}", _node),
        Route("/api/templates/{kind}", _template),
        Route("/api/jobs", _submit, methods=["POST"]),
        Route("/api/jobs/{job}", _job),
        Route("/api/jobs/{job}/history", _history),
        Route("/api/jobs/{job}/spaces", _scene("spaces", "application/json")),
        Route("/api/jobs/{job}/bodies", _bodies),
        Route("/api/jobs/{job}/cancel", _cancel, methods=["POST"]),
    ]


class _Events:
    """Passes requests to the streams, which exist only once the application has begun."""

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        await scope["app"].state.dashboard.streams(scope, receive, send)


# For scripts ----------------------------------------------------------------------------------------------------------
async def _node(request: Request) -> Response:
    found = dashboard_of(request).view.node(request.path_params["node"])
    if found is None:
        raise BadInput(f"there is no node {request.path_params['node']}")
    return JSONResponse(found)


async def _template(request: Request) -> Response:
    kind = await asyncio.to_thread(find_built_in, request.path_params["kind"])  # its import takes a second
    return PlainTextResponse(kind.template)


async def _job(request: Request) -> Response:
    view = await dashboard_of(request).show(request.path_params["job"])
    rows, columns = shape_of(view["topology"])
    shape = {"rows": rows, "columns": columns, "wraps": wraps(view["topology"])}
    told = {key: value for key, value in view.items() if key != "file_now"}
    return JSONResponse(told | _made_of(view["file_now"]) | shape)


async def _history(request: Request) -> Response:
    """Answer with the records of a job that are newer than those that the page has."""
    job, pages = request.path_params["job"], {}
    for kind in ("improvements", "history", "statistics"):
        after = as_whole(request.query_params.get(kind, "0"), kind, _MOST_RECORD)
        pages[kind] = await dashboard_of(request).ask(wire.Records(kind, job, after))
    return JSONResponse(pages)


def _scene(form: Form, media_type: str) -> Callable[[Request], Awaitable[Response]]:
    async def scene(request: Request) -> Response:
        dashboard = dashboard_of(request)
        view = await dashboard.show(request.path_params["job"])
        return Response(await dashboard.scenes.drawn(view, form), media_type=media_type)

    return scene


async def _bodies(request: Request) -> Response:
    """Answer with the bodies that move in a job's problem; a browser may keep them under their key."""
    dashboard = dashboard_of(request)
    bodies = await dashboard.scenes.bodies(await dashboard.show(request.path_params["job"]))
    if bodies is None:
        raise BadInput("problems of this kind have no bodies that move")
    if request.query_params.get("key", bodies.key) != bodies.key:
        raise HTTPException(404, "the job has other bodies now")  # its problem has changed in between
    cached = {"Cache-Control": "private, max-age=86400"} if "key" in request.query_params else {}
    return answer_of(bodies.packed, request, "application/json", cached)


async def _submit(request: Request) -> Response:
    """Submit a problem file with settings that replace those in it; empty fields replace nothing."""
    given = {field: value for field, value in (await fields_of(request, _MOST_BODY)).items() if value not in (None, "")}
    unknown = given.keys() - _FIELDS
    if unknown:
        raise BadInput(f"expected {', '.join(_FIELDS)}, found {shorten(min(unknown))}")
    text, name = text_of(given, "file", ""), text_of(given, "name", "form.toml", _MOST_NAME)
    job, priority = text_of(given, "id", "") or None, as_whole(given.get("priority", 0), "priority", wire.MOST_PRIORITY)
    settings = {"seed": as_whole(given["seed"], "seed", _MOST_SEED)} if "seed" in given else {}
    seconds = {"seconds": as_number(given["seconds"], "seconds")} if "seconds" in given else {}
    file = (await dashboard_of(request).parser.read(text, name)).with_run(**settings, **seconds)
    handed_in = await dashboard_of(request).watcher.client.submit(file, id=job, priority=priority)
    return JSONResponse({"job": handed_in.id}, 201)


async def _cancel(request: Request) -> Response:
    job: AsyncClientJob = await dashboard_of(request).watcher.client.job(request.path_params["job"])
    return JSONResponse({"job": job.id, "status": await job.cancel()})


@lru_cache(_MADE)
def _made_of(file: str) -> dict[str, Any]:
    """Return what a page shows of a problem file; large fields such as maps and meshes are left out."""
    told = ProblemFile.from_json(file)
    short = {field: value for field, value in told.fields.items() if len(json.dumps(value)) <= _SHORT}
    return {"name": told.name, "problem": short, "run": told.run.model_dump()}  # with the defaults, such as the seed


# For machines ---------------------------------------------------------------------------------------------------------
async def _metrics(request: Request) -> Response:
    return PlainTextResponse(dashboard_of(request).metrics.text(), media_type="text/plain; version=0.0.4")


async def _healthz(request: Request) -> Response:
    """Answer whether the cluster answers. Anybody may ask, so nothing else is said."""
    if dashboard_of(request).view.answers:
        return PlainTextResponse("the cluster answers\n")
    return PlainTextResponse("the cluster does not answer\n", 503)
