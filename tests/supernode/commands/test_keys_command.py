"""Clusters with keys: who may come in, what each may do, and that jobs go on while keys change. All over real TLS."""

import contextlib
import shutil
from datetime import UTC, datetime
from pathlib import Path

import pytest
from live_service import live
from places import ROOT, Places, free_port, until

import supernode
from supernode.__main__ import main
from supernode.files.authority import Authority
from supernode.files.key_folder import identity_in
from wire import sessions
from wire.keys import Keys

PROBLEM = """kind = "function"
name = "rastrigin"
dimension = 4
[run]
topology = "torus 2x2"
deme = 4
target = -1.0
stall = 1000000
"""


def run(capsys, *arguments):
    """The exit code of a command, and what it printed."""
    code = main([str(each) for each in arguments])
    captured = capsys.readouterr()
    return code, captured.out, captured.err


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "keys"
    assert main(["keys", "init", str(folder), "--address", "127.0.0.1"]) == 0
    assert main(["keys", "add", str(folder), "client", "watcher", "--may", "watch", "--days", "30"]) == 0
    return folder


@pytest.fixture(scope="module")
def endpoint():
    return f"tls/127.0.0.1:{free_port()}"


@pytest.fixture(scope="module")
def cluster(keys, endpoint, tmp_path_factory):
    log = (tmp_path_factory.mktemp("log") / "log").open("w+")
    with live(
        tmp_path_factory.mktemp("state"), "torus 2x2", "--keys", keys, "--listen", endpoint, stderr=log
    ) as service:
        service.log = log.name
        yield service


@pytest.fixture
def problem(tmp_path):
    path = tmp_path / "problem.toml"
    path.write_text(PROBLEM)
    return path


def test_keys_are_made_listed_renewed_and_revoked(capsys, tmp_path):
    folder = tmp_path / "keys"
    code, out, _ = run(capsys, "keys", "init", folder, "--address", "10.0.0.1")
    assert code == 0
    assert out == f"made {folder}, with keys for router, coordinator, spy, node, client, dashboard, for 10.0.0.1\n"
    assert run(capsys, "keys", "add", folder, "node", "h2", "--address", "10.0.0.2")[0] == 0
    _, out, _ = run(capsys, "keys", "list", folder)
    assert [line.split()[:2] for line in out.splitlines()][1:] == [
        ["router", "router"],
        ["coordinator", "coordinator"],
        ["spy", "spy"],
        ["node", "node"],
        ["client", "client"],
        ["dashboard", "dashboard"],
        ["h2", "node"],
    ]
    assert run(capsys, "keys", "renew", folder, "h2")[1].startswith("renewed h2, until 20")
    assert run(capsys, "keys", "revoke", folder, "h2")[1].startswith("revoked h2;")
    assert run(capsys, "keys", "revoke", folder, "h2")[2].startswith("error: h2: expected one of the members router,")


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["add", "client", "bob", "--may", "fly"], "--may: expected some of watch,submit,change,down, found fly"),
        (["add", "node", "h2", "--may", "watch"], "--may: expected it for a client or a dashboard only"),
        (["add", "client", "a b"], "the name of a member: expected letters"),
        (["init"], "expected an empty folder or none, found files in it"),
    ],
)
def test_wrong_input(capsys, keys, arguments, expected):
    action, *rest = arguments
    code, _, err = run(capsys, "keys", action, keys, *rest)
    assert code == 2
    assert expected in err


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["up", "--listen", "tcp/0.0.0.0:7447"], "whoever reaches it could use the cluster; expected tls/ADDRESS:PORT"),
        (["up", "--listen", "tls/0.0.0.0:7447"], "expected --keys DIR too; `supernode keys init DIR` makes keys"),
        (["up", "--keys", "KEYS", "--listen", "tcp/0.0.0.0:7447"], "expected tls/ADDRESS:PORT or quic/ADDRESS:PORT"),
        (["up", "--on", "ssh://h1"], "whoever reaches them could use the cluster; expected --insecure"),
        (["up", "--keys", "KEYS/watcher"], "expected the key folder of a router, found that of a client"),
        (["router", "--listen", "tcp/10.0.0.1:7447"], "whoever reaches it could use the cluster"),
        (["node", "--connect", "tcp/127.0.0.1:1", "--listen", "tcp/10.0.0.1:7450"], "whoever reaches it could use"),
        (["jobs", "--connect", "tls/127.0.0.1:1"], "expected keys too (--keys DIR), since the cluster asks who"),
    ],
)
def test_what_strangers_could_use_is_refused(capsys, keys, tmp_path, arguments, expected):
    state = ["--state", tmp_path / "state"] if arguments[0] == "up" else []
    code, _, err = run(capsys, *(each.replace("KEYS", str(keys)) for each in arguments), *state)
    assert code == 2
    assert expected in err


def test_each_may_do_what_its_keys_allow(capsys, cluster, keys, endpoint, problem):
    connected = ["--connect", endpoint, "--keys"]
    code, out, _ = run(capsys, "submit", problem, *connected, keys)
    assert code == 0
    job = out.strip()
    assert run(capsys, "jobs", job, *connected, keys / "watcher")[0] == 0
    code, _, err = run(capsys, "cancel", job, *connected, keys / "watcher")
    assert (code, err) == (2, "error: watcher may watch, but cancel needs the right to change\n")
    assert run(capsys, "cancel", job, *connected, keys)[0] == 0


def test_a_forger_is_refused_and_the_log_says_so(cluster, keys, endpoint):
    name = cluster.info().cluster
    watcher = identity_in(keys / "watcher", "client")
    with contextlib.closing(sessions.visitor(endpoint, 5.0, watcher)) as session:
        session.put(Keys(name).best, b"a forged improvement")
        assert list(session.get(Keys(name).requests("client", "down"), payload=b"", timeout=5.0)) == []
    for said in ("refused watcher: Put on supernode/", "refused watcher: Query on supernode/"):
        with supernode.connect(endpoint, keys) as client:
            until(lambda said=said, client=client: any(said in str(row) for row in client.logs()["rows"]))


def test_a_flood_of_refused_messages_holds_up_nobody(cluster, keys, endpoint):
    name = cluster.info().cluster
    watcher = identity_in(keys / "watcher", "client")
    with contextlib.closing(sessions.visitor(endpoint, 5.0, watcher)) as session:
        for number in range(5000):
            session.put(f"supernode/{name}/{number}", b"x")
        with supernode.connect(endpoint, keys) as client:
            assert len(client.status()["nodes"]) == 4
            client.submit(supernode.load(ROOT / "examples" / "rastrigin.toml").with_run(topology="ring 1")).result(60)


def test_a_router_keeps_its_session_while_its_keys_are_half_written(cluster, keys, endpoint):
    certificate = keys / "router" / "member.crt"
    whole = certificate.read_bytes()
    certificate.write_bytes(whole[:200])
    until(lambda: "the keys and the list of members stay those before" in Path(cluster.log).read_text())
    with supernode.connect(endpoint, keys) as client:
        assert client.status()["spy"] is not None
    certificate.write_bytes(whole)
    until(lambda: "the keys and the list of members were read anew" in Path(cluster.log).read_text())
    until(lambda: connected(endpoint, keys))


def test_a_node_cannot_pose_as_the_router(capsys, keys):
    elsewhere = f"tls/127.0.0.1:{free_port()}"
    node = identity_in(keys / "node", "node")
    with contextlib.closing(sessions.router([elsewhere], node)):
        code, _, err = run(capsys, "jobs", "--connect", elsewhere, "--keys", keys)
    assert code == 1
    assert "no cluster answers" in err


def test_strangers_find_no_cluster(capsys, cluster, endpoint, keys, tmp_path):
    foreign, expired = tmp_path / "foreign", tmp_path / "expired"
    assert run(capsys, "keys", "init", foreign)[0] == 0
    shutil.copy(keys / "routers.crt", foreign / "client")  # it trusts the cluster; the cluster does not trust it
    code, _, err = run(capsys, "jobs", "--connect", endpoint, "--keys", foreign)
    assert code == 1
    assert (
        err == f"error: no cluster answers at {endpoint}, or it does not know the keys of client in {foreign}/client\n"
    )
    until(lambda: "refused a link: invalid peer certificate: UnknownIssuer" in Path(cluster.log).read_text())
    shutil.copytree(keys, expired)
    until_then = datetime.fromisoformat(Authority(expired).renew("client", 1e-6).expires)
    until(lambda: datetime.now(UTC) > until_then)
    code, _, err = run(capsys, "jobs", "--connect", endpoint, "--keys", expired)
    assert code == 2
    assert "expired on 20" in err


def test_a_client_whose_jobs_are_long_leaves_nodes_to_others(keys, problem, tmp_path):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    options = ("--keys", keys, "--listen", endpoint, "--client-nodes", "4")
    assert main(["keys", "add", str(keys), "client", "other"]) == 0
    with (
        live(tmp_path / "state", "torus 2x4", *options),
        supernode.connect(endpoint, keys / "client") as one,
        supernode.connect(endpoint, keys / "other") as other,
    ):
        long = [one.submit(problem) for _ in range(2)]
        assert other.submit(problem, generations=20).result(60).status == "exhausted"
        assert [each.state() for each in long] == ["running", "queued"]
        with pytest.raises(supernode.BadInput, match=r"asks for 8 cells .*, one client may have 4 nodes"):
            other.submit(problem, topology="torus 2x4")


def test_a_client_with_many_jobs_gets_its_turns_beside_one_that_comes_back_at_once(keys, problem, tmp_path):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    assert main(["keys", "add", str(keys), "client", "robot"]) == 0
    with (
        live(tmp_path / "state", "torus 2x2", "--keys", keys, "--listen", endpoint),
        supernode.connect(endpoint, keys / "client") as one,
        supernode.connect(endpoint, keys / "robot") as robot,
    ):
        many = [one.submit(problem, generations=200) for _ in range(12)]
        for _ in range(6):
            assert robot.submit(problem, generations=200).result(60).status == "exhausted"
        assert many[-1].state() == "queued"
        assert {each.result(60).status for each in many} == {"exhausted"}


def test_keys_change_and_members_leave_while_a_job_runs(capsys, cluster, keys, endpoint, problem, tmp_path):
    file = supernode.load(problem).with_run(generations=4000, seed=3)
    assert run(capsys, "keys", "add", keys, "client", "guest")[0] == 0
    with supernode.connect(endpoint, keys / "client") as client:
        with supernode.connect(endpoint, keys / "guest") as guest:
            submitted = guest.submit(file)
        assert run(capsys, "keys", "renew", keys)[0] == 0
        shutil.copytree(keys / "guest", tmp_path / "guest")
        assert run(capsys, "keys", "revoke", keys, "guest")[0] == 0
        until(lambda: connected(endpoint, tmp_path / "guest") is None)
        job = client.job(submitted.id)
        result = job.result(120)
        assert job.show()["epoch"] == 0
    assert result.status == "exhausted"
    assert result.history_sha256 == supernode.simulate(file).history_sha256


def test_hosts_with_keys_are_linked_directly_and_repeat_the_simulation(tmp_path):
    made = Authority.make(tmp_path / "keys")
    made.add("router", "router", (), 1.0, ("127.0.0.1",))
    for role in ("coordinator", "spy"):
        made.add(role, role, (), 1.0, ())
    for number, name in enumerate(("upper", "lower")):
        made.add(name, "node", (), 1.0, (f"127.0.0.{number + 2}",))
    made.add("client", "client", ("watch", "submit"), 1.0, ())
    file = supernode.load(ROOT / "examples" / "arm-ik.toml").with_run(
        topology="torus 2x4", target=-1.0, generations=40, seed=5
    )
    with contextlib.closing(Places(tmp_path, None)) as places:
        places.endpoint = f"tls/127.0.0.1:{free_port()}"
        places.start("router", LISTEN=places.endpoint, KEYS=made.folder)
        places.start("coordinator", NODES=8, STATE=tmp_path, KEYS=made.folder)
        places.start("spy", KEYS=made.folder)
        for number, name in enumerate(("upper", "lower")):
            listen = f"tls/127.0.0.{number + 2}:{free_port()}"
            places.host(name, 4, LISTEN=listen, KEYS=made.folder / name)
        with until(lambda: connected(places.endpoint, made.folder)) as client:
            job = client.submit(file)
            result = job.result(60)
            root = job.show()["nodes"][0]
        local = sessions.visitor(places.endpoint, 5.0, identity_in(made.folder, "spy"))
        with contextlib.closing(local) as session:
            replies = list(session.liveliness().get("supernode/main/node/*/routed"))
            routed = {int(str(reply.ok.key_expr).split("/")[3]) for reply in replies}
    assert result.status == "exhausted"
    assert result.history_sha256 == supernode.simulate(file).history_sha256
    assert routed == {root}  # for the spy; no other message takes the way by the router


def connected(endpoint, keys):
    with contextlib.suppress(supernode.ClusterFailed):
        return supernode.connect(endpoint, keys)
    return None
