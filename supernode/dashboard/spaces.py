"""Translate 3-D drawings into plain numbers that a browser can show and turn around.

The planners draw with matplotlib, as in reports. Here the lines, solids and texts of a figure's 3-D axes become traces
of plotly, so that no planner needs a second drawing. A figure with any other artist in space is shown as a picture.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Line3D, Poly3DCollection, Text3D
    from mpl_toolkits.mplot3d.axes3d import Axes3D

Trace = dict[str, Any]

_MOST_TRIANGLES = 40_000  # in one scene: one or two megabytes for the browser
_DIGITS = 5  # significant digits of coordinates
_PIXELS_A_POINT = 4 / 3
_DISTANCE = 2.2  # of the eye from the middle, in plotly's units
_LOWER = {"x": 0, "y": 0, "z": -0.12}  # the eye looks a little below the middle: it leaves room for the axes' names


class _Unknown(Exception):  # noqa: N818
    """The figure has an artist that cannot be translated."""


def spaces_of(figure: "Figure") -> dict[str, Any]:
    """Return the scenes of a figure's 3-D axes, and in "whole" whether they are all that the figure shows."""
    drawn = [axes for axes in figure.axes if axes.name == "3d"]
    try:
        spaces = [_space(axes, axes.get_title() or figure.get_suptitle()) for axes in drawn]
    except _Unknown:
        spaces = []
    return {"spaces": spaces, "whole": 0 < len(spaces) == len(figure.axes)}


def _space(axes: "Axes3D", title: str) -> dict[str, Any]:
    traces = [trace for artist in axes.get_children() for trace in _traces(axes, artist)]
    if sum(len(trace.get("i", ())) for trace in traces) > _MOST_TRIANGLES:
        raise _Unknown
    elevation, around = np.radians([axes.elev, axes.azim])
    eye = np.array([np.cos(elevation) * np.cos(around), np.cos(elevation) * np.sin(around), np.sin(elevation)])
    sides = {
        f"{name}axis": {"range": _rounded(getattr(axes, f"get_{name}lim")()), "title": {"text": label}}
        for name, label in zip("xyz", (axes.get_xlabel(), axes.get_ylabel(), axes.get_zlabel()), strict=True)
    }
    camera = {"eye": dict(zip("xyz", (_DISTANCE * eye).tolist(), strict=True)), "center": _LOWER}
    return {"title": title, "traces": traces, "scene": {**sides, "aspectmode": "data", "camera": camera}}


def _traces(axes: "Axes3D", artist: Any) -> Iterator[Trace]:
    """Yield the traces of one artist; plotly draws axes and their background itself."""
    from matplotlib.axis import Axis
    from matplotlib.patches import Rectangle
    from mpl_toolkits.mplot3d.art3d import Line3D, Poly3DCollection, Text3D

    if artist is axes.patch or isinstance(artist, Axis | Rectangle) or not artist.get_visible():
        return
    if isinstance(artist, Line3D):
        yield _line(artist)
    elif isinstance(artist, Poly3DCollection):
        yield _solid(artist)
    elif isinstance(artist, Text3D):
        yield _words(artist)
    elif artist not in (axes.title, axes._left_title, axes._right_title):
        raise _Unknown


def _line(line: "Line3D") -> Trace:
    from matplotlib.colors import to_hex

    x, y, z = (_rounded(each) for each in line.get_data_3d())
    modes = [
        name
        for name, style in (("lines", line.get_linestyle()), ("markers", line.get_marker()))
        if style not in ("None", "none", " ", "", None)
    ]
    edge = {"color": to_hex(line.get_markeredgecolor()), "width": line.get_markeredgewidth()}
    return {
        "type": "scatter3d",
        "mode": "+".join(modes) or "none",
        "x": x,
        "y": y,
        "z": z,
        "opacity": _opacity(line.get_alpha()),
        "line": {"color": to_hex(line.get_color()), "width": 1.5 * _PIXELS_A_POINT * line.get_linewidth()},
        "marker": {
            "color": to_hex(line.get_markerfacecolor()),
            "size": line.get_markersize() * _PIXELS_A_POINT,
            "line": edge,
        },
        "name": str(line.get_label()).removeprefix("_"),
        "showlegend": not str(line.get_label()).startswith("_"),
        "hoverinfo": "skip",
    }


def _solid(solid: "Poly3DCollection") -> Trace:
    """Return a solid's faces as triangles with shared corners; their colours are shaded already."""
    from matplotlib.colors import to_hex

    faces = getattr(solid, "_faces", None)  # matplotlib has no public access to them
    colors = getattr(solid, "_facecolor3d", None)
    if faces is None or colors is None or np.any(getattr(solid, "_invalid_vertices", False)):
        raise _Unknown
    count, corners = faces.shape[:2]
    if count * (corners - 2) > _MOST_TRIANGLES:
        raise _Unknown
    places, names = np.unique(_significant(faces.reshape(-1, 3)), axis=0, return_inverse=True)
    fans = names.reshape(count, corners)
    # A face of n corners is a fan of n - 2 triangles around its first corner.
    triangles = np.stack([fans[:, [0, each, each + 1]] for each in range(1, corners - 1)], axis=1).reshape(-1, 3)
    of_faces = [to_hex(color) for color in colors]
    of_faces *= count if len(of_faces) == 1 else 1
    return {
        "type": "mesh3d",
        **dict(zip("xyz", places.T.tolist(), strict=True)),
        **dict(zip("ijk", triangles.T.tolist(), strict=True)),
        "facecolor": [color for color in of_faces for _ in range(corners - 2)],
        "opacity": _opacity(solid.get_alpha()),
        "lighting": {"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0},  # shaded already
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _words(text: "Text3D") -> Trace:
    from matplotlib.colors import to_hex

    x, y, z = ([each] for each in _rounded(text.get_position_3d()))
    return {
        "type": "scatter3d",
        "mode": "text" if text.get_text() else "none",
        "x": x,
        "y": y,
        "z": z,
        "text": [text.get_text().strip()],
        "textposition": "top center",
        "textfont": {"color": to_hex(text.get_color()), "size": 13},
        "hoverinfo": "skip",
        "showlegend": False,
    }


def _opacity(alpha: float | None) -> float:
    return 1.0 if alpha is None else float(alpha)


def _significant(values: Any) -> Any:
    values = np.asarray(values, float)
    size = float(np.max(np.abs(values), initial=0.0)) or 1.0
    return np.round(values, _DIGITS - 1 - int(np.floor(np.log10(size))))


def _rounded(values: Any) -> list[float]:
    found: list[float] = _significant(values).tolist()
    return found
