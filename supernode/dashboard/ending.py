"""How the dashboard ends: live news stop, and whoever still waits is told, instead of being cut off with a trace."""

import asyncio
import socket

import uvicorn
from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class Patient:
    """The application, which knows who waits for it.

    Args:
        app: what answers.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._waiting: set[asyncio.Task[object]] = set()
        self._ends = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, or say that this is the end."""
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
                    self._waiting.discard(task)  # it is nearly said
            await send(message)

        self._waiting.add(task)
        try:
            await self.app(scope, receive, send_and_see)
        except asyncio.CancelledError:
            if not self._ends:
                raise
            task.uncancel()
            if began:
                await send({"type": "http.response.body", "body": b""})
            else:
                await PlainTextResponse("the dashboard ends\n", 503)(scope, receive, send)
        finally:
            self._waiting.discard(task)

    def end(self) -> None:
        """Let nobody wait any longer."""
        self._ends = True
        for task in self._waiting:
            task.cancel()


class Server(uvicorn.Server):
    """A server that ends in order.

    Args:
        app: what it serves.
        config: how.
    """

    def __init__(self, app: Patient, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._app = app

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close what is open."""
        self._app.end()
        await super().shutdown(sockets)
