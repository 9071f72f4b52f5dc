"""Submit a problem to a running cluster with Zenoh alone, and print improvements and the result.

This client needs `eclipse-zenoh` and `msgpack`, but nothing of Supernode; it follows docs/protocol.md. A program in
another language can do the same.

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
RIGHTS = {"status": "watch", "show": "watch", "submit": "submit"}
ENDED = {"solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled", "failed"}
ARM = Path(__file__).parent / "arm-ik.toml"


def endpoint_of_this_machine() -> str:
    """Return the endpoint that `supernode up` wrote into the user's state folder."""
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state"
    return str(json.loads(Path(state, "supernode", "cluster.json").read_text())["endpoint"])


def open_session(endpoint: str) -> zenoh.Session:
    """Open a session as a client of the cluster's router."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    return zenoh.open(config)


def ask(session: zenoh.Session, name: str, **arguments: Any) -> Any:
    """Send a request and return the value of the answer; exit with an error line if it is refused or unanswered."""
    request = msgpack.packb([VERSION, name, arguments])
    for reply in session.get(f"supernode/*/jobs/anyone/{RIGHTS[name]}", payload=request, timeout=10.0):
        if reply.ok is None:
            break
        word, *answer = msgpack.unpackb(reply.ok.payload.to_bytes())
        if word == "refused":
            sys.exit(f"error: {answer[0]}")
        return answer[0]
    sys.exit("error: no cluster answers")


def problem_file(path: Path) -> str:
    """Return a problem file as the protocol sends it: JSON of its name, fields, ``[run]`` table and folder.

    The cluster reads no files. If a problem names other files, their content must be put into its fields
    (docs/protocol.md). This client does not do that.
    """
    fields = tomllib.loads(path.read_text())
    run = fields.pop("run", {})
    return json.dumps([path.name, fields, run, str(path.parent.resolve())])


def follow(news: "queue.SimpleQueue[tuple[str, bytes]]", job: str, number: int) -> None:
    """Print improvements until the job has ended, or until nothing has arrived for a second."""
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
    """Submit the job, print its improvements, then print its result."""
    endpoint = sys.argv[1] if len(sys.argv) > 1 else endpoint_of_this_machine()
    path = Path(sys.argv[2]) if len(sys.argv) > 2 else ARM
    news: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
    with open_session(endpoint) as session:
        cluster = ask(session, "status")["cluster"]
        for key in ("best", "state"):  # subscribe before the submit, so that no improvement is missed
            session.declare_subscriber(
                f"supernode/{cluster}/{key}", lambda sample: news.put((str(sample.key_expr), sample.payload.to_bytes()))
            )
        job = uuid.uuid4().hex  # with an id chosen by the client, a repeated submit is harmless
        ask(session, "submit", file=problem_file(path), id=job)
        shown = ask(session, "show", job=job)
        while shown["ended"] is None:  # after a deadline the nodes stop first; the result comes later
            follow(news, job, shown["number"])
            shown = ask(session, "show", job=job)
    print(json.dumps(shown["result"]))


if __name__ == "__main__":
    main()
