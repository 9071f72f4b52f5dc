"""Show an animation in a browser: a server of viser with the scene, a slider over the steps, and a button that plays.

viser is an extra (``view``): this module imports it only where the server starts.
"""

import contextlib
import io
import socket
import threading
import time
from importlib.util import find_spec
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any

import numpy as np

from problems import BadInput
from problems.animation import WORLD, Animation, Floats
from supernode.pictures.scene_nodes import (
    LINE_COLOR,
    FrameNode,
    GhostNode,
    MeshNode,
    Playback,
    SceneNodes,
    pose_of,
    seconds_of,
    slider_of,
)
from supernode.signals import on_ending_signals

if TYPE_CHECKING:
    from viser import FrameHandle, ViserServer

_MARGIN = 0.3  # m, of what surrounds the motion and is in view at first
_EYE = np.array([0.65, -0.8, 0.5])  # from the middle of what moves, in multiples of its size
_AXES = 0.1  # m, the length of a target's axes
_LINE_PIXELS = 3.0
_PERIOD = 1 / 25  # seconds between two updates of the scene


def check_viser() -> None:
    """Check that viser is installed.

    Raises:
        BadInput: if it is not; names the extra.
    """
    if find_spec("viser") is None:
        raise BadInput("view: expected viser to be installed: pip install 'supernode[view]'")


class Viewer:
    """A server that shows one animation to all browsers that connect; they share the step that is shown.

    The browsers' events arrive in threads of viser, and `tick` is called by the main thread. One lock guards the
    playback and keeps its changes in order.

    Args:
        animation: what to show.
        title: a title for people.
        host: the address to listen at.
        port: the port; 0 means any free one.

    Raises:
        BadInput: if it cannot listen there.
    """

    def __init__(self, animation: Animation, title: str, host: str, port: int) -> None:
        self._nodes = SceneNodes.of(animation)
        self._playback = Playback(animation.along, seconds_of(animation))
        self._along = animation.along
        self._lock = threading.Lock()
        self._server = _started(host, port, title)
        name = f"[{host}]" if ":" in host else host
        self.address = f"http://{name}:{self._server.get_port()}/"
        with self._server.atomic():
            self._moving = _add(self._server, self._nodes)
            self._ghosts = [_add_ghost(self._server, ghost) for ghost in self._nodes.ghosts]
        self._place_camera(animation.box(_MARGIN))
        if len(self._along) > 1:
            self._add_controls(animation.along_name)
        self._show()

    def tick(self, elapsed: float) -> None:
        """Play for so many seconds, if it plays."""
        with self._lock:
            was_playing = self._playback.playing
            if self._playback.advance(elapsed):
                value = float(self._along[self._playback.step])
                self._slider.value = value  # type: ignore[misc]  # mypy does not see the setter in viser's class
                self._show()
            if was_playing and not self._playback.playing:
                self._button.label = "play"

    def close(self) -> None:
        """Disconnect the browsers and free the port."""
        with _muted():
            self._server.stop()

    def _place_camera(self, box: Floats) -> None:
        low, high = box
        middle, size = (low + high) / 2.0, float((high - low).max())
        camera = self._server.initial_camera
        camera.position, camera.look_at = tuple(middle + size * _EYE), tuple(middle)

    def _add_controls(self, along_name: str) -> None:
        low, high, step = slider_of(self._along)
        gui = self._server.gui
        self._slider = gui.add_slider(along_name, min=low, max=high, step=step, initial_value=low)
        self._button = gui.add_button("play")
        self._slider.on_update(self._on_slider)
        self._button.on_click(self._on_button)

    def _on_slider(self, event: Any) -> None:
        if event.client is None:  # the playback itself moved the slider, and may hold the lock
            return
        with self._lock:
            self._playback.seek(float(self._slider.value))
            self._show()

    def _on_button(self, _: Any) -> None:
        with self._lock:
            self._playback.toggle()
            self._button.label = "pause" if self._playback.playing else "play"

    def _show(self) -> None:
        """Put all frames where they are at the playback's step."""
        step = self._playback.step
        with self._server.atomic():
            for number, handle in self._moving:
                handle.position, handle.wxyz = pose_of(self._nodes.placements[step, number])
            for ghost, root in zip(self._nodes.ghosts, self._ghosts, strict=True):
                root.visible = self._nodes.shown(ghost, step)


def serve(animation: Animation, title: str, host: str, port: int) -> None:
    """Show an animation, print the address, and return when Ctrl-C, SIGTERM or SIGHUP comes.

    Raises:
        BadInput: if it cannot listen at that address.
    """
    ends: SimpleQueue[None] = SimpleQueue()
    with on_ending_signals(lambda: ends.put(None)):
        viewer = Viewer(animation, title, host, port)
        try:
            print(f"view: {viewer.address}", flush=True)
            last = time.monotonic()
            while not _comes(ends, _PERIOD):
                now = time.monotonic()
                viewer.tick(now - last)
                last = now
        finally:
            viewer.close()


def _comes(queue: "SimpleQueue[None]", within: float) -> bool:
    """Wait for something in a queue; return whether it came within so many seconds."""
    try:
        queue.get(timeout=within)
    except Empty:
        return False
    return True


def _started(host: str, port: int, title: str) -> "ViserServer":
    """Return a server that listens at exactly that address."""
    free = _free_port(host, port)
    with _muted():  # it would print a table of its addresses
        from viser import ViserServer

        class LocalServer(ViserServer):
            """A server that no page can ask to be relayed by a public one; viser checks no page's origin."""

            def request_share_url(self, verbose: bool = True) -> None:
                """Refuse."""

        server = LocalServer(host=host, port=free, label=title, verbose=False)
    if server.get_port() != free:  # it takes the next port if another process was quicker
        with _muted():
            server.stop()
        raise _in_use(host, port, "Address already in use")
    server.scene.set_up_direction("+z")
    server.gui.configure_theme(show_share_button=False, show_logo=False)
    return server


def _free_port(host: str, port: int) -> int:
    """Return the port if it is free, or any free one in place of 0: viser itself would silently take another port."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as sock:
        try:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            sock.bind((host, port))
        except OSError as error:
            raise _in_use(host, port, error.strerror or str(error)) from None
        return int(sock.getsockname()[1])


def _in_use(host: str, port: int, reason: str) -> BadInput:
    return BadInput(f"--host, --port: cannot listen at {host}:{port}: {reason}; --port 0 takes any free port")


def _muted() -> contextlib.AbstractContextManager[Any]:
    return contextlib.redirect_stdout(io.StringIO())


def _add(server: "ViserServer", nodes: SceneNodes) -> "list[tuple[int, FrameHandle]]":
    """Add all nodes but the ghosts; return the frames that move, with their numbers."""
    scene = server.scene
    moving = [(node.frame, _add_frame(server, node)) for node in nodes.frames]
    _add_meshes(server, nodes.meshes)
    for name, segments in nodes.lines:
        scene.add_line_segments(
            name, points=segments, colors=LINE_COLOR, thickness=_LINE_PIXELS, thickness_units="screen"
        )
    for name, placement in nodes.targets:
        position, wxyz = pose_of(placement)
        scene.add_frame(name, axes_length=_AXES, axes_radius=0.04 * _AXES, position=position, wxyz=wxyz)
    return [(number, handle) for number, handle in moving if number != WORLD]


def _add_ghost(server: "ViserServer", ghost: GhostNode) -> "FrameHandle":
    """Add a ghost; return the node that shows or hides all of it."""
    root = server.scene.add_frame(ghost.name, show_axes=False)
    for node in ghost.frames:
        handle = _add_frame(server, node)
        handle.position, handle.wxyz = pose_of(ghost.placements[node.frame])
    _add_meshes(server, ghost.meshes)
    return root


def _add_frame(server: "ViserServer", node: FrameNode) -> "FrameHandle":
    return server.scene.add_frame(node.name, show_axes=False)


def _add_meshes(server: "ViserServer", meshes: tuple[MeshNode, ...]) -> None:
    for mesh in meshes:
        # The triangles may be wound either way round, so both sides are drawn; corners are sharp.
        server.scene.add_mesh_simple(
            mesh.name,
            vertices=mesh.vertices,
            faces=mesh.triangles,
            color=mesh.color,
            opacity=mesh.opacity,
            flat_shading=True,
            side="double",
        )
