"""A real `supernode up`, whose processes a test may kill."""

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import supernode
import supernode.client.cluster_info

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 60.0  # seconds
_LOOK_EVERY = 0.01  # seconds


def until(condition, patience=PATIENCE):
    """What ``condition`` says once that is something."""
    end = time.monotonic() + patience
    while not (found := condition()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(_LOOK_EVERY)
    return found


def end_all_jobs(client):
    """Cancel what has not ended, and wait until it has."""
    for each in client.jobs():
        if each["ended"] is None:
            client.job(each["job"]).cancel()
    until(lambda: all(each["ended"] is not None for each in client.jobs()))


def log_texts(client, job):
    """What the cluster's log says of a job."""
    told = client.logs(job.id)
    return [row[told["columns"].index("text")] for row in told["rows"]]


def children_of(process):
    """Process ids."""
    try:
        return [int(each) for each in Path(f"/proc/{process}/task/{process}/children").read_text().split()]
    except OSError:
        return []


def command_of(process):
    """Its command line, "" if it has ended."""
    try:
        return Path(f"/proc/{process}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""


class LiveService:
    """A cluster that stays up, until `close`."""

    def __init__(self, state, topology="torus 4x4", *options, stderr=None):
        self.state = state
        command = [sys.executable, "-m", "supernode", "up", "--topology", topology, "--state", str(state), *options]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, env=environment, text=True)
        try:
            self._meet()
        except BaseException:
            self.close()  # whoever asked for it never gets it to close
            raise

    def _meet(self):
        """Wait until it is up; learn its first line, its zygote and its folder."""
        self.line = self.process.stdout.readline()
        assert self.line.startswith("up: "), self.line
        children = children_of(self.process.pid)
        (self.zygote,) = (each for each in children if "coordinator.launch.zygote" in command_of(each))
        self.folder = Path(self.info().endpoint.partition("/")[2]).parent

    def info(self):
        return supernode.client.cluster_info.read_info(self.state)

    def connect(self):
        return supernode.connect(self.state)

    def processes(self):
        """Of the cluster, by name."""
        found = {}
        for process in children_of(self.zygote):
            with contextlib.suppress(OSError):
                name = Path(f"/proc/{process}/comm").read_text().strip()
                if name.startswith("sn "):
                    found[name.removeprefix("sn ")] = process
        return found

    def kill(self, name, kind=signal.SIGKILL):
        """Kill one, and wait until another lives in its place. The names are cut, as `ps` shows them."""
        victim = self.processes()[name]
        os.kill(victim, kind)
        until(lambda: self.processes().get(name, victim) != victim)

    def all_gone_within(self, seconds, kill):
        """Whether every process of the cluster ends within so many seconds after ``kill`` was called."""
        watched = [os.pidfd_open(process) for process in [*self.processes().values(), self.zygote, self.process.pid]]
        kill()
        end = time.monotonic() + seconds
        waiting = list(watched)
        while waiting and time.monotonic() < end:
            ready, _, _ = select.select(waiting, [], [], max(0.0, end - time.monotonic()))
            waiting = [each for each in waiting if each not in ready]
        for each in watched:
            os.close(each)
        return not waiting

    def close(self):
        if self.process.poll() is None:
            self.process.terminate()
        try:
            self.process.wait(PATIENCE)
        finally:
            self.process.kill()
            self.process.stdout.close()


@contextlib.contextmanager
def live(state, topology="torus 4x4", *options, stderr=None):
    service = LiveService(state, topology, *options, stderr=stderr)
    try:
        yield service
    finally:
        service.close()


def address_in(line):
    """The address of the dashboard in the line that a cluster prints when it is ready."""
    return line.split("dashboard ")[1].split(": ")[-1].strip()
