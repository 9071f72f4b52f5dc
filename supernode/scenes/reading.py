"""Read the files of a scene, whatever their format."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from problems.errors import BadInput
from supernode.scenes.benchmark_problems import is_benchmark, read_problem
from supernode.scenes.moveit_messages import read_messages
from supernode.scenes.moveit_text import read_scene
from supernode.scenes.scene import Scene

_MOST_BYTES = 200_000_000


def read_files(names: Sequence[str], problem: int | None) -> Scene:
    """Return what the files say together, such as a scene and a request.

    Args:
        names: the files.
        problem: which problem of a file that has many; None for the first.

    Raises:
        BadInput: if a file cannot be read; one line that names it and the field.
    """
    scene, many = Scene(), False
    for name in names:
        plain = _plain(name)
        if isinstance(plain, str):
            scene = scene.joined(read_scene(plain, name))
        elif is_benchmark(plain):
            scene, many = scene.joined(read_problem(plain, 1 if problem is None else problem, name)), True
        else:
            scene = scene.joined(read_messages(plain, name))
    if problem is not None and not many:
        raise BadInput(f"--problem: expected a file with many problems, found {', '.join(names)}; leave it out")
    return scene


def _plain(name: str) -> Any:
    """Return the plain values of YAML or JSON, or the text of a ``.scene`` file."""
    text = _text(Path(name))
    suffix = Path(name).suffix.lower()
    if suffix == ".scene":
        return text
    if suffix == ".json":
        return _json(text, name)
    if suffix in (".yaml", ".yml"):
        return _yaml(text, name)
    raise BadInput(f"{name}: expected a file that ends in .scene, .yaml, .yml or .json, found {suffix or 'no ending'}")


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise BadInput(
                f"{path}: expected at most {_MOST_BYTES // 1_000_000} MB, found {path.stat().st_size:,} bytes"
            )
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInput(f"{path}: expected a scene, found no such file") from None
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: expected a text in UTF-8, found {error}") from None
    except OSError as error:
        raise BadInput(f"{path}: expected a file that can be read, found {error.strerror}") from None


def _json(text: str, name: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: expected JSON, found {error}") from None


def _yaml(text: str, name: str) -> Any:
    try:
        import yaml
    except ImportError:
        raise BadInput(f"{name}: reading YAML needs pyyaml; pip install 'supernode[robots]'") from None
    try:
        # `ros2 topic echo` and rosbag end each message by a line ---: the first one counts.
        return next(iter(yaml.load_all(text, getattr(yaml, "CSafeLoader", yaml.SafeLoader))), None)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise BadInput(f"{name}: expected YAML, found {error}") from None
