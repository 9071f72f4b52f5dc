import os

import pytest

from supernode.deploy.surroundings import Surroundings, surroundings

PROCESSORS = len(os.sched_getaffinity(0))
MACHINE = os.uname().nodename


@pytest.mark.parametrize(
    ("environment", "name", "label"),
    [
        ({}, None, ""),
        ({"SLURMD_NODENAME": "n7"}, "n7", ""),
        ({"SLURMD_NODENAME": "n7", "SLURM_LOCALID": "1"}, "n7-1", ""),
        (
            {
                "SLURMD_NODENAME": "n7",
                "SLURM_TOPOLOGY_ADDR": "spine.leaf[1-2].n7",
                "SLURM_TOPOLOGY_ADDR_PATTERN": "switch.switch.node",
            },
            "n7",
            "spine/leaf-1-2-",
        ),
        ({"SLURMD_NODENAME": "n7", "SLURM_TOPOLOGY_ADDR": "n7", "SLURM_TOPOLOGY_ADDR_PATTERN": "node"}, "n7", ""),
        ({"JOB_COMPLETION_INDEX": "3"}, "agent-3", ""),
        ({"OMPI_COMM_WORLD_RANK": "2"}, f"{MACHINE}-2", ""),
        ({"PMI_RANK": "0"}, f"{MACHINE}-0", ""),
    ],
)
def test_an_engine_says_where_a_process_is(environment, name, label):
    assert surroundings(environment) == Surroundings(name, label, PROCESSORS)
