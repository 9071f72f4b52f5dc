"""What cells keep from one evaluation to the next comes together in the solution, however the cells are run."""

from pathlib import Path

import pytest

import supernode
from node.plan import Plan
from node.simulation import simulate
from spy.collector import Collector
from spy.past import best_known, stopped_after
from spy.result import states_of, stop_reasons
from spy.verification import verify

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


@pytest.fixture(scope="module")
def cluster():
    with supernode.LocalCluster(torus=(2, 3)) as cluster:
        yield cluster


def simulated(file):
    plan = Plan.of(file)
    reports = simulate(plan)
    collector = Collector(plan, job=1)
    collector.hear(best_known(reports, plan.run.spy), 0.0)
    reasons = stop_reasons(reports, plan.run.mode)
    return verify(collector, stopped_after(reports), reasons, states=states_of(reports)).best.solution


@pytest.mark.parametrize("example", ["arm-path", "arm-path-four-links"])
@pytest.mark.parametrize(("recipe", "deme"), [("tuned", 1), ("paper", 1), ("tuned", 6)])
def test_processes_and_simulator_have_evaluated_the_same(cluster, example, recipe, deme):
    file = supernode.load(EXAMPLES / f"{example}.toml")
    run = {"recipe": recipe, "deme": deme, "target": -1.0, "generations": 12, "seed": 5}
    solution = cluster.submit(file, **run).result().found
    assert solution == simulated(file.with_run(topology="torus 2x3", **run))
    assert solution["cspace_evaluated"] > 0.0
