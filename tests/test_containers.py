"""The containers' description, and its services as plain processes with the very settings that it gives them."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import urllib.error
import urllib.request

import pytest
import yaml
from places import ROOT, free_port, places, until

import supernode
from supernode.__main__ import main

COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
SERVICES = COMPOSE["services"]
OWN = {name: described for name, described in SERVICES.items() if described["image"] == "supernode"}
DOCKERFILE = (ROOT / "Dockerfile").read_text()


@pytest.mark.skipif(shutil.which("docker-compose") is None, reason="needs docker-compose")
def test_docker_compose_accepts_the_file():
    command = ["docker-compose", "--profile", "postgres", "config", "--services"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == SERVICES.keys()


@pytest.mark.parametrize("service", OWN)
def test_each_service_runs_a_command_that_knows_its_settings(service, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*SERVICES[service]["command"], "--help"])
    assert ended.value.code == 0
    help_text = capsys.readouterr().out
    assert all(f"[{name}]" in help_text for name in SERVICES[service]["environment"])


@pytest.mark.parametrize("service", SERVICES)
def test_each_service_has_a_health_check_and_no_more_rights_than_it_needs(service):
    described = SERVICES[service]
    assert described["healthcheck"]["test"]
    assert described["cap_drop"] == ["ALL"]
    assert all(port.startswith("127.0.0.1:") for port in described.get("ports", ()))


def test_what_a_service_depends_on_is_there():
    for described in SERVICES.values():
        assert set(described.get("depends_on", ())) <= SERVICES.keys()
        assert {volume.split(":")[0] for volume in described.get("volumes", ())} <= COMPOSE["volumes"].keys()
        assert set(described["networks"]) <= COMPOSE["networks"].keys()


def test_coordinator_spy_and_nodes_share_the_secret_and_nobody_else_has_it():
    shared = "secret:/var/lib/supernode-secret"
    having = {name for name, described in SERVICES.items() if shared in described.get("volumes", ())}
    told = {name for name, described in OWN.items() if "SUPERNODE_SECRET_FILE" in described["environment"]}
    assert having == told == {"coordinator", "spy", "node"}
    folder = shared.partition(":")[2]
    assert re.search(rf"install --directory --owner=supernode .*{folder}( |$)", DOCKERFILE, re.MULTILINE)


def test_the_nodes_are_as_many_as_the_coordinator_expects():
    node = SERVICES["node"]
    expected = int(SERVICES["coordinator"]["environment"]["SUPERNODE_NODES"])
    assert node["scale"] * int(node["environment"]["SUPERNODE_NODES"]) == expected


def test_no_container_runs_as_root_and_the_image_has_the_python_that_the_project_asks_for():
    *_, final = DOCKERFILE.split("\nFROM ")
    assert re.findall(r"^USER (.+)$", final, re.MULTILINE) == ["supernode"]
    python = re.search(r"^ARG PYTHON=(.+)$", DOCKERFILE, re.MULTILINE)[1]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert f">={python}" in project["requires-python"]
    used = set(re.findall(r"more\['(\w+)'\]", DOCKERFILE))
    assert used <= project["optional-dependencies"].keys()


def test_the_services_as_plain_processes_solve_a_job():
    """Names of containers become addresses of this machine; all else is as it is described."""
    with places(None) as cluster:
        page = f"127.0.0.1:{free_port()}"
        replaced = {
            "tcp/router:7447": cluster.endpoint,
            "tcp/0.0.0.0:7447": cluster.endpoint,
            "/var/lib/supernode": str(cluster.folder),
            "/var/lib/supernode-secret/secret": str(cluster.folder / "secret"),
            "0.0.0.0:8080": page,
            "${SUPERNODE_DATABASE:-}": "",
        }
        started = []
        for name, described in OWN.items():
            for copy in range(described.get("scale", 1)):
                told = {"tcp/0.0.0.0:7450": f"tcp/127.0.0.{copy + 2}:{free_port()}"} | replaced
                variables = {key: told.get(value, value) for key, value in described["environment"].items()}
                started.append((name, variables))
                command = [told.get(word, word) for word in described["command"]]
                if "entrypoint" in described:
                    command = prepared(described, command, cluster.folder)
                cluster.run(f"{name} {copy}", command, variables)
        with cluster.client() as client:
            result = client.submit(supernode.load(ROOT / "examples" / "arm-ik.toml")).result(100)
        for name, variables in dict(started).items():
            until(lambda name=name, variables=variables: is_healthy(SERVICES[name], variables, cluster.endpoint, page))
        with pytest.raises(urllib.error.HTTPError, match="401"):
            urllib.request.urlopen(f"http://{page}/", timeout=20)
        token = (cluster.folder / "token").read_text().strip()
        asked = urllib.request.Request(f"http://{page}/", headers={"Authorization": f"Bearer {token}"})
        with urllib.request.urlopen(asked, timeout=20) as answer:
            assert answer.status == 200
    assert (result.status, result.nodes) == ("solved", 16)


def test_spy_and_nodes_are_not_healthy_before_the_cluster_has_them():
    with places(1) as cluster, cluster.client() as client:
        until(lambda: client.status()["spy"] is not None)
        cluster.kill("spy")
        until(lambda: client.status()["spy"] is None)
        variables = {"SUPERNODE_CONNECT": cluster.endpoint}
        nowhere = f"127.0.0.1:{free_port()}"
        healthy = [name for name in OWN if is_healthy(SERVICES[name], variables, cluster.endpoint, nowhere)]
        assert healthy == ["router", "coordinator"]
        cluster.start("spy")
        cluster.host("lower", 1)
        until(lambda: is_healthy(SERVICES["spy"], variables, cluster.endpoint))
        until(lambda: client.status()["nodes"])
        assert not is_healthy(SERVICES["node"], variables, cluster.endpoint), "it is another host's"
        assert is_healthy(SERVICES["node"], variables | {"SUPERNODE_HOST": "lower"}, cluster.endpoint)


def prepared(described, command, folder):
    """The words of `supernode` that the service's own entry point runs, once it has done what comes before."""
    *shell, script, name = described["entrypoint"]
    script = script.replace("$$", "$").replace("/var/lib/supernode", shlex.quote(str(folder)))
    script = script.replace("python ", f"{shlex.quote(sys.executable)} ").replace("exec supernode", "printf '%s\\n'")
    for _ in range(2):  # it is started anew now and then
        done = subprocess.run([*shell, script, name, *command], capture_output=True, text=True, check=True)
    return [word.replace("/var/lib/supernode", str(folder)) for word in done.stdout.splitlines()]


def is_healthy(described, variables, endpoint, page="127.0.0.1:8080"):
    """What the engine would find out; the image has `supernode` and `python` on its path."""
    kind, *words = described["healthcheck"]["test"]
    words = [word.replace("$$", "$").replace("7447", endpoint.rpartition(":")[2]) for word in words]
    words = [word.replace("127.0.0.1:8080", page) for word in words]
    command = ["sh", "-c", f'supernode() {{ "{sys.executable}" -m supernode "$@"; }}; {words[0]}']
    if kind == "CMD":
        command = [sys.executable if word == "python" else word for word in words]
    environment = os.environ | {"PYTHONPATH": str(ROOT)} | variables
    return subprocess.run(command, env=environment, check=False, stdout=subprocess.DEVNULL).returncode == 0
