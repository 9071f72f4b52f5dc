"""What tests of the dashboard share: one in this process, before a coordinator that the test plays."""

import contextlib
import http.client
import json
import queue
import shutil
import ssl
import subprocess
import threading
from urllib.parse import urlencode

import pytest
from live_service import until

from supernode.client.cluster_info import Place
from supernode.dashboard.listen_address import ListenAddress
from supernode.dashboard.server import serve


class Shown:
    """A dashboard that serves in a thread; over TLS if it has a certificate and a key."""

    def __init__(self, endpoint, tokens=None, certificate=None, key=None):
        listen_address = ListenAddress("127.0.0.1", 0, tokens or {}, certificate, key)
        self._trust = None if certificate is None else ssl.create_default_context(cafile=certificate)
        self.socket = listen_address.listen()
        self.home = listen_address.address(self.socket)
        self.port = self.socket.getsockname()[1]
        servers = queue.SimpleQueue()
        arguments = (Place.at(endpoint), listen_address, self.socket, servers.put)
        self._thread = threading.Thread(target=serve, args=arguments)
        self._thread.start()
        self._server = servers.get()

    @property
    def dashboard(self):
        return until(lambda: getattr(self._server.config.app.app.app.state, "dashboard", None))

    @property
    def credentials(self):
        return self._server.config.app.app._credentials

    @property
    def streams(self):
        return self.dashboard.streams

    @property
    def ended(self):
        return not self._thread.is_alive()

    def ask(self, method, path, body=None, **headers):
        """Status, headers and text of the answer; the path goes out as it is."""
        if self._trust is None:
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        else:
            connection = http.client.HTTPSConnection("127.0.0.1", self.port, timeout=20, context=self._trust)
        with contextlib.closing(connection):
            connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read().decode()

    def post(self, path, value, **headers):
        return self.ask("POST", path, json.dumps(value), **({"Content_Type": "application/json"} | headers))

    def log_in(self, token, **headers):
        """Status, headers and text of the answer to the form of the login page."""
        form = {"Content_Type": "application/x-www-form-urlencoded"}
        return self.ask("POST", "/login", urlencode({"token": token}), **(form | headers))

    def json(self, path):
        """The answer of a dashboard that has found its cluster."""
        until(lambda: self.dashboard.view.answers)
        status, _, text = self.ask("GET", path)
        assert status == 200, text
        return json.loads(text)

    def close(self):
        self._server.should_exit = True
        self._thread.join()


@pytest.fixture
def show_at():
    """Starts a dashboard of the cluster at an endpoint."""
    with contextlib.ExitStack() as stack:

        def start(endpoint, *arguments):
            shown = Shown(endpoint, *arguments)
            stack.callback(shown.close)
            return shown

        yield start


@pytest.fixture
def show(service, show_at):
    """Starts a dashboard of the played cluster; call it with tokens and a certificate, or without."""
    return lambda *arguments: show_at(service.endpoint, *arguments)


@pytest.fixture
def shown(show):
    return show()


def self_signed(folder, name="tls"):
    """The files of a new certificate for this machine and of its key."""
    if shutil.which("openssl") is None:
        pytest.skip("no openssl on this machine (Debian: apt-get install openssl)")
    certificate, key = folder / f"{name}.pem", folder / f"{name}-key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    command += ["-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1", "-days", "2"]
    command += ["-out", certificate, "-keyout", key]
    subprocess.run(command, check=True, capture_output=True)
    return str(certificate), str(key)


@pytest.fixture
def certified(tmp_path):
    """Makes certificates; call it with a name for each further one."""
    return lambda *name: self_signed(tmp_path, *name)


@pytest.fixture
def page_of(chromium):
    """Opens pages of a dashboard that may neither complain nor ask anybody but that one.

    Name it after the fixtures that serve the pages: fixtures end in reverse order, and an open page complains of a
    server that is gone.
    """
    pages, complaints = [], []

    def complain_of_foreign(request, home):
        if not request.url.startswith((home, "data:")):
            complaints.append(request.url)

    def opened(home):
        page = chromium.new_page(viewport={"width": 1280, "height": 800})
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: complain_of_foreign(request, home))
        pages.append(page)
        return page

    yield opened
    for page in pages:
        page.close()
    assert complaints == []
