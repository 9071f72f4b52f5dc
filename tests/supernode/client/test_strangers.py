"""What a plain Zenoh client cannot do who reaches the port of a cluster: give the commands of its coordinator."""

import contextlib
import json
import threading
from pathlib import Path

import pytest
import zenoh
from live_service import ROOT, live
from places import free_port

import supernode
from problems import ProblemFile, Run
from wire import control, sessions
from wire.callbacks import direct
from wire.control import Begin, Drop, Finish, Halt, Look, Prepare, ProposeStop, Wiring
from wire.exchange import VERSION
from wire.keys import Keys
from wire.seal import Seal
from wire.strict import pack

EXAMPLE = ROOT / "examples/arm-ik.toml"
EVIL = "import pathlib\npathlib.Path({!r}).touch()\n"


class Stranger:
    """A plain Zenoh client at a cluster's port."""

    def __init__(self, session: zenoh.Session, keys: Keys) -> None:
        self.session = session
        self.keys = keys

    def ask(self, key: str, payload: bytes) -> list[object]:
        """What all who are asked by that key say."""
        replies = self.session.get(
            key,
            payload=payload,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=10.0,
        )
        return [control.decode_answer(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]

    def ask_everybody(self, payload_for) -> list[str]:
        """What nodes and spy say to what ``payload_for`` makes of a key."""
        answers = []
        for key in (self.keys.every_control, self.keys.spy_control):
            answers += self.ask(key, payload_for(key))
        assert len(answers) == 5, "four nodes and the spy"
        assert all(isinstance(answer, control.Refused) for answer in answers), answers
        return [answer.message for answer in answers]


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    state = tmp_path_factory.mktemp("state")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with live(state, "torus 2x2", "--listen", endpoint) as service:
        yield service, endpoint


@pytest.fixture
def stranger(cluster):
    service, endpoint = cluster
    with contextlib.closing(sessions.client(endpoint)) as session:
        yield Stranger(session, Keys(service.info().cluster))


def preparation(kind: str, folder: Path, job: int = 10**6) -> Prepare:
    fields = {"kind": kind, "name": "sphere", "dimension": 2} if kind == "function" else {"kind": kind}
    file = ProblemFile("x.toml", fields, Run(topology="torus 2x2", mode="async"), folder)
    return Prepare(job, 0, file.to_json(), Wiring(0, (0, 1, 2, 3)))


def forged(command: control.Command, kind: str):
    """A way to make a command up: as it was before there were seals, or sealed with another secret."""
    if kind == "no seal":
        return lambda _: control.encode(command)
    return lambda key: Seal(bytes(32)).close(key, control.encode(command))


def file(**run):
    return supernode.load(EXAMPLE).with_run(topology="torus 2x2", **run)


def still_solves(cluster) -> bool:
    service, _ = cluster
    with service.connect() as client:
        return client.submit(file()).result(60).solved


@pytest.mark.parametrize("kind", ["no seal", "another secret"])
def test_no_module_of_a_stranger_s_choice_is_imported(cluster, stranger, tmp_path, kind):
    ran = tmp_path / "ran"
    (tmp_path / "evil_module.py").write_text(EVIL.format(str(ran)))
    said = stranger.ask_everybody(forged(preparation("evil_module:Problem", tmp_path), kind))
    assert all(each.endswith("bad command: not of this cluster") for each in said)
    assert not ran.exists()
    assert still_solves(cluster)


@pytest.mark.parametrize("kind", ["no seal", "another secret"])
def test_no_file_of_a_stranger_s_choice_is_opened(cluster, stranger, tmp_path, kind):
    diary = tmp_path / "diary"
    diary.write_text("dear diary")
    right = preparation("function", tmp_path)
    with_log = [
        VERSION,
        "prepare",
        right.job,
        right.epoch,
        right.file,
        [0, [0, 1, 2, 3]],
        None,
        b"",
        str(diary),
        b"",
        4,
    ]
    for payload in (pack(with_log), pack([*with_log[:-3], *with_log[-2:]])):  # as it once was, and without the path
        stranger.ask_everybody(
            lambda key, payload=payload: payload if kind == "no seal" else Seal(bytes(32)).close(key, payload)
        )
    assert diary.read_text() == "dear diary"
    assert still_solves(cluster)


@pytest.mark.parametrize("kind", ["no seal", "another secret"])
def test_no_job_of_a_stranger_s_is_begun_and_none_of_others_is_ended(cluster, stranger, tmp_path, kind):
    service, _ = cluster
    prepare = preparation("function", tmp_path)
    for command in (prepare, Begin(prepare.job, 0)):
        stranger.ask_everybody(forged(command, kind))
    with service.connect() as client:
        assert all(node["job"] is None for node in client.status()["nodes"])
        job = client.submit(file(target=-1.0, seconds=60.0))
        next(iter(job.improvements()))
        number = job.show()["number"]
        for command in (
            Drop(number),
            Halt(number, 0),
            ProposeStop(number, 0, "cancel"),
            Look(number),
            Finish(number, 0, None, 3, ()),
        ):
            stranger.ask_everybody(forged(command, kind))
        job.cancel()
        assert job.result(60).status == "cancelled"


def test_a_command_that_was_overheard_cannot_be_given_again(cluster, stranger):
    heard: list[tuple[str, bytes]] = []
    came = threading.Event()

    def hear(query: zenoh.Query) -> None:
        heard.append((str(query.key_expr), query.payload.to_bytes()))
        query.drop()
        came.set()

    declared = [
        stranger.session.declare_queryable(key, direct(hear))
        for key in (stranger.keys.control(99), stranger.keys.spy_control)
    ]
    assert still_solves(cluster)
    assert came.wait(10)
    for each in declared:
        each.undeclare()
    assert {key for key, _ in heard} >= {stranger.keys.every_control}
    for key, payload in heard:
        answers = stranger.ask(key, payload)
        assert answers
        assert all(answer.message.endswith("bad command: repeated") for answer in answers)
    assert still_solves(cluster)


def test_nodes_and_spy_know_themselves_which_modules_they_may_import(tmp_path):
    """Though the coordinator itself told them to: it reads what they are asked to do from a database."""
    from node.node_config import NodeConfig
    from node.process import NodeProcess
    from problems.modules import Modules
    from spy.process import SpyProcess

    ran = tmp_path / "ran"
    (tmp_path / "evil_module.py").write_text(EVIL.format(str(ran)))
    router_endpoint = f"tcp/127.0.0.1:{free_port()}"
    with contextlib.closing(sessions.router([router_endpoint])):
        config = NodeConfig("c1", 0, "", tmp_path, router_endpoint, bytes(32), Modules(["own"], tmp_path))
        node, spy = NodeProcess(config), SpyProcess(config)
        for process, prepare in ((node, node.epochs.prepare), (spy, spy._prepare)):
            with contextlib.closing(process.control):
                answer = prepare(preparation("evil_module:Problem", tmp_path))
                assert (answer.blame, "--allow-module evil_module" in answer.message) == ("input", True)
    assert not ran.exists()


def test_the_secret_is_in_no_command_line_and_no_message(cluster, stranger):
    service, _ = cluster
    command = Path(f"/proc/{service.zygote}/cmdline").read_text().split("\0")
    assert command[-2:] == ["coordinator.launch.zygote", ""]
    assert json.loads((service.state / "cluster.json").read_text()).keys() == {
        "endpoint",
        "cluster",
        "process",
        "version",
    }
