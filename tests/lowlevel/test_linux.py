"""System calls of Linux and the ordinary paths beside them, in processes of their own."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from lowlevel.capabilities import PLAIN

ROOT = Path(__file__).resolve().parent.parent.parent
ENDS_WITHIN = 20.0  # seconds, on a busy machine
CHILD = (
    "import os, signal; from lowlevel import linux; linux.end_with_parent(PARENT); print(1, flush=True); signal.pause()"
)
PARENT = f"""
import os, signal, subprocess, sys
child = subprocess.Popen([sys.executable, "-c", {CHILD!r}.replace("PARENT", str(os.getpid()))], stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
signal.pause()
"""
both_ways = pytest.mark.parametrize("plain", ["", "1"], ids=["usual", "plain"])


def runs(process):
    """Whether it does; one that has ended may wait for somebody to ask how."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@both_ways
def test_a_process_ends_with_its_parent(plain):
    command = [sys.executable, "-c", PARENT]
    with subprocess.Popen(command, cwd=ROOT, env=os.environ | {PLAIN: plain}, stdout=subprocess.PIPE) as parent:
        child = int(parent.stdout.readline())
        assert runs(child)
        parent.send_signal(signal.SIGKILL)
        parent.wait()
        deadline = time.monotonic() + ENDS_WITHIN
        while runs(child):
            assert time.monotonic() < deadline
            time.sleep(0.02)


@both_ways
def test_a_process_whose_parent_has_gone_ends_at_once(plain):
    script = "from lowlevel import linux; linux.end_with_parent(-1); print('still here')"
    command = [sys.executable, "-c", script]
    environment = os.environ | {PLAIN: plain}
    found = subprocess.run(command, cwd=ROOT, env=environment, check=False, capture_output=True, text=True)
    assert found.returncode in (1, -signal.SIGKILL)
    assert found.stdout == ""


@both_ways
def test_the_length_of_turns_is_asked_for_only_where_that_is_safe_and_the_name_everywhere(plain):
    script = (
        "from pathlib import Path; from lowlevel import linux; "
        "linux.name_process('sn test'); linux.wake_up_promptly(); linux.ask_for_turns(0.02); "
        "print(Path('/proc/self/comm').read_text().strip(), Path('/proc/self/timerslack_ns').read_text().strip())"
    )
    command = [sys.executable, "-c", script]
    environment = os.environ | {PLAIN: plain}
    done = subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True, text=True)
    *name, slack = done.stdout.split()
    assert name == ["sn", "test"]
    assert (slack == "1") == (plain == "")
