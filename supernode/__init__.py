"""Supernode: robot motion planning by a genetic algorithm on a torus of real processes.

Start a cluster for one program and submit a job to it::

    import supernode

    with supernode.LocalCluster(torus=(4, 4)) as cluster:
        job = cluster.submit(supernode.load("examples/arm-ik.toml"), seed=1, seconds=5)
        for best in job.improvements():
            print(best.fitness, best.feasible, best.solution)
        result = job.result()

Simulate the same run in this process, generation by generation::

    result = supernode.simulate("examples/arm-ik.toml", seed=1, callback=lambda generation: print(generation.best))

Solve a problem made in Python, on processes that are started for this call::

    robot = supernode.load_robot("example-robot-data:panda", group="arm")
    table = supernode.Box(size=[1.0, 1.0, 0.1], position=[0.8, 0.0, 0.2])
    problem = supernode.RobotPath(robot=robot, start=[...], goal=[...], obstacles=[table])
    path = supernode.solve(problem, torus="2x2", seconds=1).path

Submit a job to a cluster that is up already (``supernode up``)::

    with supernode.connect() as client:
        job = client.submit("examples/arm-ik.toml", seed=1, seconds=5)

With asyncio use `connect_async` and await the same methods.

To plan for a problem of your own, derive a class from `Problem` and choose a coding for its individuals: `BitString`,
`RealVector` or `Permutation`.

Input that is wrong raises `BadInput`; a cluster that cannot be reached or breaks raises `ClusterFailed`.

Names are imported when they are first used, so that ``supernode --help`` answers at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coordinator import ClusterFailed, Job, LocalCluster
    from genetics import BitString, Permutation, RealVector, Recipe
    from problems import Answer, BadInput, Clearance, Problem, ProblemFile, Table, Verdict, load, quantity
    from spy.result import Result
    from supernode.client.async_client import AsyncClient, connect_async
    from supernode.client.async_job import AsyncClientJob
    from supernode.client.client import Client, ClientJob, connect
    from supernode.deploy.ray_cluster import RayCluster
    from supernode.robots import Box, Cylinder, Mesh, RobotIk, RobotPath, Sphere, load_robot
    from supernode.runs.simulation import Generation, simulate
    from supernode.runs.solving import solve
    from wire.news import Improvement

_HOMES = {
    "Answer": "problems",
    "AsyncClient": "supernode.client.async_client",
    "AsyncClientJob": "supernode.client.async_job",
    "BadInput": "problems",
    "BitString": "genetics",
    "Clearance": "problems",
    "Client": "supernode.client.client",
    "ClientJob": "supernode.client.client",
    "ClusterFailed": "coordinator",
    "Improvement": "wire.news",
    "Generation": "supernode.runs.simulation",
    "Job": "coordinator",
    "LocalCluster": "coordinator",
    "Permutation": "genetics",
    "Problem": "problems",
    "ProblemFile": "problems",
    "RayCluster": "supernode.deploy.ray_cluster",
    "RealVector": "genetics",
    "Recipe": "genetics",
    "Result": "spy.result",
    "Table": "problems",
    "Verdict": "problems",
    "connect": "supernode.client.client",
    "connect_async": "supernode.client.async_client",
    "load": "problems",
    "quantity": "problems",
    "simulate": "supernode.runs.simulation",
    "Box": "supernode.robots",
    "Cylinder": "supernode.robots",
    "Mesh": "supernode.robots",
    "RobotIk": "supernode.robots",
    "RobotPath": "supernode.robots",
    "Sphere": "supernode.robots",
    "load_robot": "supernode.robots",
    "solve": "supernode.runs.solving",
}

__all__ = [
    "Answer",
    "AsyncClient",
    "AsyncClientJob",
    "BadInput",
    "BitString",
    "Box",
    "Clearance",
    "Client",
    "ClientJob",
    "ClusterFailed",
    "Cylinder",
    "Generation",
    "Improvement",
    "Job",
    "LocalCluster",
    "Mesh",
    "Permutation",
    "Problem",
    "ProblemFile",
    "RayCluster",
    "RealVector",
    "Recipe",
    "Result",
    "RobotIk",
    "RobotPath",
    "Sphere",
    "Table",
    "Verdict",
    "connect",
    "connect_async",
    "load",
    "load_robot",
    "quantity",
    "simulate",
    "solve",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'supernode' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
