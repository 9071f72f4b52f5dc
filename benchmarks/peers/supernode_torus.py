"""Supernode's own row: a torus of node processes in lockstep, with as many islands as the peers' rings.

measure.py runs this script like the peers' scripts, in this project's environment.
"""

import json
import sys
from pathlib import Path

import supernode
from problems.file import parse

_NEVER = -1.0


def main() -> None:
    """Print a JSON line when ready, then one with the outcome."""
    setting = json.loads(sys.argv[1])
    file = parse(f'kind = "function"\nname = "rastrigin"\ndimension = {setting["dimension"]}\n', "peers", Path())
    with supernode.LocalCluster(topology=setting["topology"]) as cluster:
        workers = [process for name, process in cluster.processes.items() if name.startswith("node")]
        print(json.dumps({"spawn": cluster.seconds_to_ready, "workers": workers}), flush=True)
        result = cluster.submit(
            file,
            deme=setting["deme"],
            interval=setting["interval"],
            seed=setting["seed"],
            seconds=setting["seconds"],
            generations=setting["generations"],
            target=_NEVER if setting["target"] is None else setting["target"],
        ).result()
        ended = {"seconds": result.seconds, "generations": result.generations, "evaluations": result.evaluations}
        error = {"error": f"the job ends as “failed”: {result.message}"} if result.status == "failed" else {}
        print(json.dumps(ended | {"best": result.fitness, "history": result.history_sha256} | error), flush=True)


if __name__ == "__main__":
    main()
