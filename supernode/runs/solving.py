"""Solve a problem from Python on a cluster of its own, in one call."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from problems import Problem, ProblemFile
from problems.in_memory import file_of

if TYPE_CHECKING:
    from spy.result import Result


def solve(
    problem: ProblemFile | Problem | str | Path,
    *,
    force: bool = False,
    on_node_death: Literal["replace", "fail"] = "replace",
    **run: Any,
) -> "Result":
    """Solve a problem on processes that are started for it, and return its result.

    ::

        result = supernode.solve(problem, torus="2x2", seconds=1)
        print(result.status, result.fitness, result.path)

    To solve several problems, a `LocalCluster` that stays saves the start. `simulate` takes the same arguments and
    starts no process.

    Args:
        problem: a problem file from `load`, the path of one, or a problem made in Python. The class of a user's own
            problem must be in a module that other processes can import.
        force: start it even if this machine cannot hold so many nodes.
        on_node_death: "replace" to have another process take the place of one that dies, "fail" to fail the job.
        run: settings that replace those of the file's ``[run]`` table, such as ``seed=1`` or ``seconds=5``.

    Returns:
        The result. If the problem's code broke, its `status` is "failed" and its `message` says why.

    Raises:
        BadInput: if the problem or a setting is wrong.
        ClusterFailed: if the cluster cannot be started or breaks.
    """
    from coordinator import LocalCluster

    file = file_of(problem).with_run(**run)
    file.refuse_unreachable()
    with LocalCluster(topology=file.run.topology, force=force, on_node_death=on_node_death) as cluster:
        return cluster.submit(file).result()
