"""What an engine tells a process about the machine that it has put it on: name, place, and processors."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from typing import NamedTuple


class Surroundings(NamedTuple):
    """What is known of a machine where `supernode node` is not told it.

    Attributes:
        name: the machine's name in the cluster; None if no engine gives one.
        label: where it is, from the largest unit to the smallest, such as ``hall2/rack7``; "" if that is not known.
        nodes: the number of processors that this process may use.
    """

    name: str | None
    label: str
    nodes: int


def surroundings(environment: Mapping[str, str]) -> Surroundings:
    """Return what Slurm, an indexed job of Kubernetes, or MPI says; the processors are those of the process itself.

    All of them limit a process to its share of processors by its affinity, which is therefore counted.
    """
    processors = len(os.sched_getaffinity(0))
    if machine := environment.get("SLURMD_NODENAME"):
        return Surroundings(_ranked(machine, environment, "SLURM_LOCALID"), _switches(environment), processors)
    if index := environment.get("JOB_COMPLETION_INDEX"):
        return Surroundings(f"agent-{index}", "", processors)
    for rank in ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK"):
        if (number := environment.get(rank)) is not None:
            return Surroundings(f"{os.uname().nodename}-{number}", "", processors)
    return Surroundings(None, "", processors)


def _ranked(machine: str, environment: Mapping[str, str], rank: str) -> str:
    """Return the name of a process: the machine's for the first on it, else that and its number."""
    number = environment.get(rank, "0")
    return machine if number == "0" else f"{machine}-{number}"


def _switches(environment: Mapping[str, str]) -> str:
    """Return the switches above a machine, as Slurm's plugin topology/tree names them, without the machine itself."""
    address = environment.get("SLURM_TOPOLOGY_ADDR", "").split(".")
    pattern = environment.get("SLURM_TOPOLOGY_ADDR_PATTERN", "").split(".")
    above = [unit for unit, kind in zip(address, pattern, strict=False) if kind != "node"]
    return "/".join(re.sub(r"[^\w.-]", "-", unit) for unit in above)  # a level may list several switches
