"""Write the file with which an engine starts a cluster on many machines: a Slurm script, or Kubernetes manifests.

docs/deploy.md says what to do with it. The torus is the largest that the machines hold.
"""

import argparse

from supernode import exits
from supernode.commands.run_options import whole

EXAMPLE = "supernode deploy slurm --hosts 8 --nodes 32 -o cluster.sbatch"

_ENGINES = {"slurm": "slurm.sbatch", "kubernetes": "kubernetes.yaml"}
_MEGABYTES = 200, 12  # of memory, for an agent and for each of its nodes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the engine, the size of the cluster, and the file."""
    parser.add_argument("engine", metavar="ENGINE", choices=tuple(_ENGINES), help=" or ".join(_ENGINES))
    parser.add_argument("--hosts", type=whole, default=4, metavar="N", help="how many machines, or pods (%(default)s)")
    parser.add_argument("--nodes", type=whole, default=16, metavar="N", help="how many nodes on each (%(default)s)")
    parser.add_argument("--time", metavar="TIME", help="slurm: the longest time that it runs (1:00:00)")
    parser.add_argument("--image", metavar="IMAGE", help="kubernetes: the image, built from the Dockerfile (supernode)")
    parser.add_argument("-o", "--output", metavar="FILE", help="the file to write (standard output)")


def run(options: argparse.Namespace) -> int:
    """Fill in the engine's file, and write it."""
    from importlib import resources

    from supernode.files.outputs import write_output

    text = (resources.files("supernode.deploy") / _ENGINES[options.engine]).read_text(encoding="utf-8")
    for name, value in _values(options).items():
        text = text.replace(f"<<{name}>>", str(value))
    if options.output is None:
        print(text, end="")
        return exits.OK
    write_output(text.encode(), options.output)
    print(f"wrote {options.output}; its first lines say how to use it")
    return exits.OK


def _values(options: argparse.Namespace) -> dict[str, object]:
    """Return what the places of an engine's file are filled in with.

    Raises:
        BadInput: if a number is 0, or an option is another engine's.
    """
    import math
    import re

    from coordinator.jobs.node_hosts import PORTS
    from problems.errors import BadInput
    from supernode.deploy.addresses import MOST_PORTS

    for name in ("hosts", "nodes"):
        if getattr(options, name) < 1:
            raise BadInput(f"--{name}: expected a whole number, at least 1, found {getattr(options, name)}")
    most = MOST_PORTS // PORTS - 1
    if options.nodes > most:
        raise BadInput(f"--nodes: expected at most {most} on a machine, {PORTS} ports each, found {options.nodes}")
    for name, engine in (("time", "slurm"), ("image", "kubernetes")):
        if getattr(options, name) is not None and options.engine != engine:
            raise BadInput(f"--{name}: expected it with {engine} only, found it with {options.engine}")
    for name, form, example in (
        ("time", r"[\d:-]+", "1-12:00:00"),
        ("image", r"[\w./:@-]+", "example.org/supernode:1"),
    ):
        value = getattr(options, name)
        if value is not None and not re.fullmatch(form, value):
            raise BadInput(f"--{name}: expected one such as {example}, found {value!r}")
    cells = options.hosts * options.nodes
    rows = max(each for each in range(1, math.isqrt(cells) + 1) if cells % each == 0)
    base, each = _MEGABYTES
    ports = 1 + PORTS * options.nodes  # on one machine: the router's, and the nodes'
    return {
        "hosts": options.hosts,
        "nodes": options.nodes,
        "cells": cells,
        "torus": f"{rows}x{cells // rows}",
        "ports": ports,
        "slots": max(1, MOST_PORTS // ports),
        "time": options.time or "1:00:00",
        "image": options.image or "supernode",
        "memory": base + each * options.nodes,
    }
