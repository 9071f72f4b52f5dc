"""A cluster on Ray: four of Ray's nodes on this machine, one of which goes while a job runs."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from places import ROOT, until

import supernode
from supernode.__main__ import main

ray = pytest.importorskip("ray", reason="an extra")
pytestmark = pytest.mark.timeout(400)
ENDLESS = 'kind = "function"\nname = "onemax"\ndimension = 32\n[run]\ntarget = -1.0\n'
# Deceptive: 40 blocks of 5 bits lead away from the optimum. As onemax it is solved in seconds.
HARD = 'kind = "function"\nname = "trap"\ndimension = 200\n[run]\ntopology = "torus 4x4"\nstall = 1000000\n'


def supernodes():
    """The words of all processes that run a command of supernode, by id."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"supernode" in words and b"-m" in words:
            found[int(folder.name)] = words
    return found


@pytest.fixture(scope="module")
def machines():
    from ray.cluster_utils import Cluster

    os.environ["RAY_DEDUP_LOGS"] = "0"
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 2})
    others = [cluster.add_node(num_cpus=2) for _ in range(3)]
    ray.init(address=cluster.address, log_to_driver=False)
    yield cluster, others
    ray.shutdown()
    cluster.shutdown()


def test_a_machine_goes_and_the_job_goes_on(machines, tmp_path):
    cluster, others = machines
    before = supernodes()
    path = tmp_path / "endless.toml"
    path.write_text(ENDLESS)
    with supernode.RayCluster(nodes=16) as on_ray:
        example = supernode.load(str(ROOT / "examples" / "arm-ik.toml")).with_run(topology="torus 4x4", seed=1)
        result = on_ray.submit(example).result(60)
        assert result.history_sha256 == supernode.simulate(example).history_sha256
        (placement,) = _placements(on_ray, path)
        assert placement["crossing"] / placement["edges"] <= 0.5  # blocks of 2 x 2
        path.write_text(HARD)
        job = on_ray.submit(path, seconds=200)
        until(lambda: job.state() == "running")
        first = ray.util.placement_group_table(on_ray._groups[0])["bundles_to_node_id"][0]
        cluster.remove_node(next(each for each in others if each.node_id != first))
        until(lambda: job.show()["epoch"] > 0)
        until(lambda: all(node["process"] for node in on_ray.status()["nodes"]))
        job.update(name="onemax")
        assert job.result(120).status == "solved"
        on_ray.grow(4)
        larger = example.with_run(topology="torus 4x5")
        assert on_ray.submit(larger).result(60).history_sha256 == supernode.simulate(larger).history_sha256
    until(lambda: supernodes().keys() <= before.keys())
    assert list(Path(tempfile.gettempdir()).glob(f"sn-ray-{on_ray._name}-*")) == []


def test_up_and_down(machines, tmp_path):
    cluster, _ = machines
    before = supernodes()
    command = ["up", "--on", "ray", "--nodes", "8", "--state", str(tmp_path), "--detach", "--insecure"]
    told = {"RAY_ADDRESS": cluster.address, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-m", "supernode", *command], env=os.environ | told, capture_output=True, text=True, check=True
    )
    assert done.stdout.startswith("up: 8 nodes (torus 2x4) on ray, tcp/"), done.stdout
    with supernode.connect(tmp_path) as client:
        example = supernode.load(str(ROOT / "examples" / "arm-ik.toml")).with_run(topology="torus 2x4", seed=1)
        assert client.submit(example).result(60).history_sha256 == supernode.simulate(example).history_sha256
    assert main(["down", "--state", str(tmp_path)]) == 0
    until(lambda: supernodes().keys() <= before.keys())


def _placements(on_ray, path):
    job = on_ray.submit(path, topology="torus 4x4")
    until(lambda: job.state() == "running")
    found = on_ray.status()["placements"]
    job.cancel()
    job.result(30)
    return found


def test_ray_says_what_is_wrong():
    with pytest.raises(supernode.BadInput, match="nodes: expected at least one for each of 4 hosts, found 2"):
        supernode.RayCluster(nodes=2, hosts=4)
