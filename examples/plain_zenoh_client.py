"""Submit a problem to a running cluster with Zenoh alone, and print improvements and the result.

It needs `eclipse-zenoh` and `msgpack`, and nothing of supernode: docs/protocol.md is all that it knows. A program in
another language does the same.

    supernode up --detach
    python examples/plain_zenoh_client.py
    python examples/plain_zenoh_client.py tcp/192.168.1.7:7447 my-problem.toml
"""

import json
import os
import queue
import sys
import tomllib
import uuid
from pathlib import Path
from typing import Any

import msgpack
import zenoh

VERSION = 1  # of the protocol
ENDED = {"solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled", "failed"}
ARM = Path(__file__).parent / "arm-ik.toml"


def endpoint_of_this_machine() -> str:
    """What `supernode up` left in the user's state folder."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return str(json.loads(Path(state, "supernode", "cluster.json").read_text())["endpoint"])


def open_session(endpoint: str) -> zenoh.Session:
    """A client of the cluster's router."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def ask(session: zenoh.Session, name: str, **arguments: Any) -> Any:
    """The value that the cluster answers with."""
    request = msgpack.packb([VERSION, name, arguments])
    for reply in session.get("supernode/*/jobs", payload=request, timeout=10.0):
        if reply.ok is None:
            break
        word, *answer = msgpack.unpackb(reply.ok.payload.to_bytes())
        if word == "refused":
            sys.exit(f"error: {answer[0]}")
        return answer[0]
    sys.exit("error: no cluster answers")


def problem_file(path: Path) -> str:
    """A problem as it travels: JSON of its name, its own fields, how to run it, and its folder.

    The cluster reads no files: a problem that names some needs what they hold in its fields (docs/protocol.md).
    """
    fields = tomllib.loads(path.read_text())
    run = fields.pop("run", {})
    return json.dumps([path.name, fields, run, str(path.parent.resolve())])


def follow(news: "queue.SimpleQueue[tuple[str, bytes]]", job: str, number: int) -> None:
    """Print improvements until the job has ended, or nothing has come for a second."""
    while True:
        try:
            key, payload = news.get(timeout=1.0)
        except queue.Empty:
            return
        message = msgpack.unpackb(payload)
        if key.endswith("/best"):
            of_job, epoch, seconds, generation, _cell, fitness, feasible, solution = message
            if of_job == number:
                place = f"{seconds:.3f} s  epoch {epoch}  generation {generation}"
                print(f"{place}  fitness {fitness:.6g}  {'solution' if feasible else 'attempt'} {solution}")
        elif message[0] == VERSION and message[1] == job and message[3] in ENDED:
            return


def main() -> None:
    """Submit, follow, show."""
    endpoint = sys.argv[1] if len(sys.argv) > 1 else endpoint_of_this_machine()
    path = Path(sys.argv[2]) if len(sys.argv) > 2 else ARM
    news: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    with open_session(endpoint) as session:
        cluster = ask(session, "status")["cluster"]
        for key in ("best", "state"):  # before the job is there, so that nothing is missed
            session.declare_subscriber(
                f"supernode/{cluster}/{key}", lambda sample: news.put((str(sample.key_expr), sample.payload.to_bytes()))
            )
        job = uuid.uuid4().hex  # an id of one's own makes a repeated submit harmless
        ask(session, "submit", file=problem_file(path), id=job)
        shown = ask(session, "show", job=job)
        while shown["ended"] is None:  # after a deadline nodes stop first, and then there is a result
            follow(news, job, shown["number"])
            shown = ask(session, "show", job=job)
    print(json.dumps(shown["result"]))


if __name__ == "__main__":
    main()
