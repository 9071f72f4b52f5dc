"""TLS, tokens and sessions by every way in which a dashboard is started."""

import os
import signal
import ssl
import subprocess
import sys
import urllib.request
from urllib.error import HTTPError

import pytest
from live_service import ROOT, address_in, children_of, command_of, live, until

from supernode.exits import INTERRUPTED, NOT_REACHED

SUPERNODE = [sys.executable, "-m", "supernode"]
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}
TOKEN, READER = "s3cret-s3cret-s3cret", "reader-reader-reader"


class Visitor(urllib.request.HTTPRedirectHandler):
    """Asks a dashboard that has the certificate."""

    def __init__(self, certificate):
        trust = ssl.create_default_context(cafile=certificate)
        self._opener = urllib.request.build_opener(urllib.request.HTTPSHandler(context=trust), self)

    def redirect_request(self, *_):
        """Follow none."""

    def ask(self, address, body=None, **headers):
        """Status and headers of the answer; 0 if there is none."""
        asked = urllib.request.Request(address, body, headers)
        try:
            with self._opener.open(asked, timeout=20) as answer:
                return answer.status, answer.headers
        except HTTPError as error:
            return error.code, error.headers
        except OSError:
            return 0, {}


@pytest.fixture
def options(tmp_path, certified):
    certificate, key = certified()
    tokens = tmp_path / "tokens"
    tokens.touch(0o600)
    tokens.write_text(f"{TOKEN}\n{READER} read\n")
    files = ["--dashboard-cert", certificate, "--dashboard-key", key, "--dashboard-token-file", str(tokens)]
    return ["--dashboard", "127.0.0.1:0", *files]


@pytest.fixture
def visitor(certified, options):
    return Visitor(options[options.index("--dashboard-cert") + 1])


def of(token):
    return {"Authorization": f"Bearer {token}"}


def is_guarded(visitor, home):
    assert home.startswith("https://127.0.0.1:")
    assert until(lambda: visitor.ask(home)[0]) == 401
    assert visitor.ask(home, **of(READER))[0] == 200
    return visitor.ask(home + "api/jobs/x/cancel", b"", **of(READER))[0] == 403


def test_up_shows_over_tls_and_browsers_stay_logged_in_when_the_dashboard_is_replaced(tmp_path, options, visitor):
    with live(tmp_path / "state", "torus 1x2", *options) as cluster:
        home = address_in(cluster.line)
        assert is_guarded(visitor, home)
        cookie = visitor.ask(home + "login", f"token={READER}".encode())[1]["Set-Cookie"].partition(";")[0]
        assert visitor.ask(home, Cookie=cookie)[0] == 200
        (victim,) = [each for each in children_of(cluster.process.pid) if "supernode.dashboard" in command_of(each)]
        os.kill(victim, signal.SIGKILL)
        until(lambda: visitor.ask(home, Cookie=cookie)[0] == 200)


def test_spy_shows_over_tls(service, options, visitor):
    command = [*SUPERNODE, "spy", "--connect", service.endpoint, *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=ENVIRONMENT, text=True) as process:
        try:
            assert is_guarded(visitor, address_in(process.stdout.readline()))
        finally:
            process.kill()


def test_solve_shows_over_tls(tmp_path, options, visitor):
    path = tmp_path / "endless.toml"
    run = '[run]\ntopology = "torus 1x2"\ntarget = -1.0\nstall = 1000000\nseconds = 100\n'
    path.write_text(f'kind = "function"\nname = "rastrigin"\ndimension = 200\n{run}')
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*SUPERNODE, "solve", path, "--json", *options], env=ENVIRONMENT, **pipes) as process:
        try:
            assert is_guarded(visitor, address_in(next(line for line in process.stderr if "dashboard " in line)))
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=30)
            assert process.returncode in (NOT_REACHED, INTERRUPTED)  # it may not have begun to breed yet
        finally:
            process.kill()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            ["--dashboard", "127.0.0.1:0", "--dashboard-cert", "no.pem", "--dashboard-key", "no.pem"],
            "-cert: {here}no.pem",
        ),
        (["--dashboard-cert", "a.pem"], "-cert: expected --dashboard too"),
        (["--dashboard-insecure"], "-insecure: expected --dashboard too"),
    ],
)
@pytest.mark.parametrize("command", [["up"], ["spy"], ["solve", str(ROOT / "examples" / "arm-ik.toml")]])
def test_what_is_wrong_is_said_in_one_line(tmp_path, command, options, said):
    here = {"cwd": tmp_path, "env": ENVIRONMENT, "timeout": 60}
    ended = subprocess.run([*SUPERNODE, *command, *options], check=False, capture_output=True, text=True, **here)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith("error: --dashboard" + said.format(here=f"{tmp_path}/"))
