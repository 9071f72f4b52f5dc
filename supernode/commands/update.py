"""Tell a job that its world has moved: it goes on, from what it has, in the new one."""

import argparse
import json
import tomllib
from pathlib import Path
from typing import Any

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, add_job, connected, tell

EXAMPLE = "supernode update 5f3a09c1 moved.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which job, and what is new."""
    add_job(parser)
    parser.add_argument("patch", metavar="PATCH.toml", help="keys of a problem file, each in place of the old")
    add_cluster_options(parser, "the number of the new world")


def run(options: argparse.Namespace) -> int:
    """Print the number of the new world."""
    patch = _read(options.patch)
    with connected(options) as client:
        world = client.job(options.job).update(patch)
    tell(options, {"job": options.job, "world": world}, f"{options.job}: world {world}")
    return exits.OK


def _read(name: str) -> dict[str, Any]:
    from problems.errors import BadInput

    try:
        patch: dict[str, Any] = json.loads(json.dumps(tomllib.loads(Path(name).read_text("utf-8")), default=str))
    except OSError as error:
        raise BadInput(f"{name}: expected a patch of a problem file, found {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: expected TOML, found {error}") from error
    if not patch:
        raise BadInput(f"{name}: expected keys of a problem file, found nothing")
    return patch
