"""Run the dashboard's process beside a cluster; see `keeper`. The process exits when its standard input ends."""

import json
import os
import socket
import sys
import threading
import time

import uvicorn

from problems.errors import BadInput
from supernode.client.cluster_info import Place
from supernode.dashboard.listen_address import ListenAddress
from supernode.dashboard.server import NICENESS, serve

_END_WITHIN = 3.0  # seconds after the end of standard input in which the process exits, whatever it is busy with


def main() -> None:
    """Serve on the socket that was inherited; the first line of standard input is the configuration as JSON."""
    config = json.loads(sys.stdin.buffer.readline())
    os.nice(NICENESS)
    sock = socket.socket(fileno=config["socket"])  # inherited, and listening already
    place, listen_address = Place.at(config["endpoint"]), ListenAddress(**config["listen_address"])
    try:
        serve(place, listen_address, sock, _tie_to_parent, single=config["single"])
    except BadInput as error:
        sys.exit(f"error: {error}")


def _tie_to_parent(server: uvicorn.Server) -> None:
    threading.Thread(target=_end_with_parent, args=(server,), daemon=True).start()


def _end_with_parent(server: uvicorn.Server) -> None:
    sys.stdin.buffer.read()  # returns when the parent closes the pipe or dies, however it dies
    server.should_exit = True
    time.sleep(_END_WITHIN)
    os._exit(0)  # a server that has not ended by now is stuck


if __name__ == "__main__":
    main()
