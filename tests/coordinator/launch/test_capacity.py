import os
import resource
from pathlib import Path

import pytest

from coordinator import LocalCluster
from coordinator.launch import capacity, cgroups
from coordinator.launch.host import HostZygote
from node.evaluation_limits import EvaluationLimits
from problems import BadInput
from problems.modules import Modules
from wire.hosts import Host

GIB = 1 << 30
V2_MOUNT = "30 23 0:26 / /sys/fs/cgroup rw,nosuid - cgroup2 cgroup2 rw,nsdelegate\n"
V1_MOUNTS = (
    "35 31 0:32 {0} /sys/fs/cgroup/memory rw,relatime shared:9 - cgroup cgroup rw,memory\n"
    "39 31 0:36 {0} /sys/fs/cgroup/pids rw,relatime shared:10 - cgroup cgroup rw,pids\n"
)


def write(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def machine(root: Path, **more: str) -> Path:
    """A machine of 24 GiB without control groups."""
    return write(
        root,
        {
            "proc/meminfo": "MemTotal: 25165824 kB\nMemAvailable: 25165824 kB\n",
            "proc/loadavg": "0.00 0.01 0.05 1/200 4711\n",
            "proc/sys/kernel/pid_max": "4194304\n",
            "proc/sys/kernel/threads-max": "192730\n",
            **more,
        },
    )


def decisive(root: Path) -> capacity.Limit:
    return min(capacity.limits(root=root), key=lambda limit: limit.nodes)


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})


def test_a_small_machine_may_have_an_everyday_torus(tmp_path: Path, two_cores: None) -> None:
    assert decisive(machine(tmp_path)).nodes >= 32 * 32


def test_the_cores_limit_a_machine_with_much_memory(tmp_path: Path, two_cores: None) -> None:
    least = decisive(machine(tmp_path))
    assert (least.nodes, least.reason) == (2048, "2 cores may take 1024 nodes each")


def test_available_memory_limits(tmp_path: Path, two_cores: None) -> None:
    root = machine(tmp_path, **{"proc/meminfo": f"MemTotal: 25165824 kB\nMemAvailable: {2 << 20} kB\n"})
    least = decisive(root)
    assert least.nodes == (2 * GIB - (200 << 20)) // capacity.NODE_BYTES
    assert least.reason == "2.0 GiB of memory are available, and a node may need 10 MiB"


@pytest.mark.parametrize(("name", "threads"), [("pid_max", 5040), ("threads-max", 5040)])
def test_the_kernel_s_number_of_threads_limits(tmp_path: Path, two_cores: None, name: str, threads: int) -> None:
    least = decisive(machine(tmp_path, **{f"proc/sys/kernel/{name}": str(threads + 200)}))
    assert least.nodes == 1000
    assert least.reason == f"5040 threads are left of kernel.{name}, and a node may need 5"


def test_the_user_s_number_of_processes_limits_but_not_root(
    tmp_path: Path, two_cores: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = machine(tmp_path)
    write(root, {"proc/4711/task/4711/stat": "", "proc/4711/task/4712/stat": ""})
    monkeypatch.setattr(
        resource, "getrlimit", lambda which: {resource.RLIMIT_NPROC: (542, 542)}.get(which, (1 << 20,) * 2)
    )
    monkeypatch.setattr(os, "getuid", lambda: (root / "proc/4711").stat().st_uid)
    is_root = os.getuid() == 0
    assert decisive(root).nodes == (2048 if is_root else 100)
    monkeypatch.setattr(os, "getuid", lambda: 1234)  # of whom nothing runs
    least = decisive(root)
    assert least.nodes == 100
    assert "542 threads are left of this user's process limit (ulimit -u)" in least.reason


def test_open_files_of_the_router_limit_only_where_it_runs(
    tmp_path: Path, two_cores: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = machine(tmp_path)
    monkeypatch.setattr(resource, "getrlimit", lambda _: (1024, 1024))
    monkeypatch.setattr(os, "getuid", lambda: 0)
    least = decisive(root)
    assert least.nodes == 1024 - 40
    assert "a router may open 1024 files" in least.reason
    assert min(limit.nodes for limit in capacity.limits(has_router=False, root=root)) == 2048


def test_groups_of_version_2_limit_from_the_own_one_up(tmp_path: Path, two_cores: None) -> None:
    root = machine(
        tmp_path,
        **{
            "proc/self/cgroup": "0::/user.slice/job\n",
            "proc/self/mountinfo": V2_MOUNT,
            "sys/fs/cgroup/user.slice/job/pids.max": "max\n",
            "sys/fs/cgroup/user.slice/pids.max": "1000\n",
            "sys/fs/cgroup/user.slice/pids.current": "460\n",
            "sys/fs/cgroup/user.slice/job/memory.max": str(4 * GIB),
            "sys/fs/cgroup/user.slice/job/memory.current": str(3 * GIB),
            "sys/fs/cgroup/user.slice/job/memory.stat": f"anon 1\ninactive_file {2 * GIB}\n",
        },
    )
    assert cgroups.processes_left(root) == 540
    assert cgroups.memory_left(root) == 3 * GIB
    least = decisive(root)
    assert least.nodes == 100
    assert least.reason == "540 threads are left of this control group's pids.max, and a node may need 5"


@pytest.mark.parametrize(
    ("mounted", "folder"), [("/", "docker/4f2a/"), ("/docker/4f2a", "")], ids=["host's view", "container's view"]
)
def test_groups_of_version_1_limit(tmp_path: Path, two_cores: None, mounted: str, folder: str) -> None:
    memory, pids = (f"sys/fs/cgroup/{each}/{folder}" for each in ("memory", "pids"))
    root = machine(
        tmp_path,
        **{
            "proc/self/cgroup": "8:pids:/docker/4f2a\n4:memory:/docker/4f2a\n0::/\n",
            "proc/self/mountinfo": V1_MOUNTS.format(mounted),
            f"{memory}memory.limit_in_bytes": str(2 * GIB),
            f"{memory}memory.usage_in_bytes": str(GIB),
            f"{pids}pids.max": "max\n",
        },
    )
    assert cgroups.processes_left(root) is None
    least = decisive(root)
    assert least.nodes == (GIB - (200 << 20)) // capacity.NODE_BYTES
    assert "1.0 GiB are left of this control group's memory limit" in least.reason


def test_version_1_s_word_for_no_limit_is_none(tmp_path: Path) -> None:
    root = write(
        tmp_path,
        {
            "proc/self/cgroup": "4:memory:/\n",
            "proc/self/mountinfo": V1_MOUNTS.format("/"),
            "sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
        },
    )
    assert cgroups.memory_left(root) is None


def test_the_refusal_says_how_many_and_why_unless_somebody_insists(two_cores: None) -> None:
    with pytest.raises(BadInput, match=r"expected at most \d+ nodes, .* now \(.+\), found 90000; .* --force"):
        capacity.check(90_000)
    capacity.check(90_000, force=True)


def test_nothing_is_launched_where_too_many_nodes_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    with pytest.raises(BadInput, match="found 90000"):
        LocalCluster(torus=(300, 300))
    with pytest.raises(BadInput, match="found 90000"):
        HostZygote(
            "x", "tcp/127.0.0.1:1", bytes(32), Modules(), Host("id", "name", 90_000, ""), limits=EvaluationLimits()
        )
    assert not list(tmp_path.iterdir())


def test_who_insists_gets_what_was_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(capacity, "limits", lambda _: [capacity.Limit(1, "it is a small machine")])
    with pytest.raises(BadInput, match="it is a small machine"):
        LocalCluster(torus=(1, 2))
    with LocalCluster(torus=(1, 2), force=True) as cluster:
        assert {"node 0", "node 1"} <= cluster.processes.keys()
