"""End the dashboard in order: stop live updates, and answer requests that still wait instead of cutting them off."""

import asyncio
import socket

import uvicorn
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class CancellableApp:
    """An ASGI application that knows which requests are waiting for its answer.

    Only the server's loop may use it.

    Args:
        app: the application that answers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._waiting: set[asyncio.Task[object]] = set()
        self._ends = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; if the dashboard ends meanwhile, answer that it does."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        task = asyncio.current_task()
        assert task is not None, "a request is a task"
        began = False

        async def send_and_see(message: Message) -> None:
            nonlocal began
            if message["type"] == "http.response.start":
                began = True
                if "content-length" in Headers(raw=message["headers"]):
                    self._waiting.discard(task)  # the answer is complete and short: let it be sent
            await send(message)

        self._waiting.add(task)
        try:
            await self.app(scope, receive, send_and_see)
        except asyncio.CancelledError:
            if not self._ends:
                raise
            # `end` cancelled this task. The answer must still be completed, so the task goes on.
            task.uncancel()
            if began:
                await send({"type": "http.response.body", "body": b""})
            else:
                await PlainTextResponse("the dashboard ends\n", 503)(scope, receive, send)
        finally:
            self._waiting.discard(task)

    def end(self) -> None:
        """Cancel all requests that wait."""
        self._ends = True
        for task in self._waiting:
            task.cancel()


class Server(uvicorn.Server):
    """A server that ends the requests that wait before it closes its connections.

    Args:
        app: the application.
        config: the configuration of the server, with the same application.
    """

    def __init__(self, app: CancellableApp, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._app = app

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End waiting requests, then close what is open; uvicorn calls this."""
        self._app.end()
        await super().shutdown(sockets)
