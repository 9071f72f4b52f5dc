"""What the dashboard tells of a job that ends within a second: its figures agree with each other."""

import pytest
from live_service import ROOT, live

import supernode

EXAMPLE = ROOT / "examples/arm-ik.toml"


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    with live(tmp_path_factory.mktemp("state"), "torus 2x2") as service:
        yield service


@pytest.fixture
def told(service, show_at):
    """All that a page asks for about a job that is over."""
    with service.connect() as client:
        job = client.submit(supernode.load(EXAMPLE), id="short", topology="torus 2x2", generations=30, target=-1.0)
        result = job.result(60)
    shown = show_at(service.info().endpoint)
    return result, shown.json("/api/jobs/short"), shown.json("/api/jobs/short/history")


def test_the_last_figures_are_those_of_the_end(told):
    result, job, history = told
    rows = [dict(zip(history["statistics"]["columns"], row, strict=True)) for row in history["statistics"]["rows"]]
    last = rows[-1]
    assert (last["generation"], last["evaluations"]) == (result.generations, result.evaluations)
    assert last["messages"] == result.messages["sent"]
    assert last["best"] <= last["median"] <= last["worst"]
    assert last["best"] >= job["fitness"] == result.fitness
    improvements = history["improvements"]
    fitnesses = [row[improvements["columns"].index("fitness")] for row in improvements["rows"]]
    assert fitnesses[-1] == result.fitness
    assert fitnesses == sorted(fitnesses, reverse=True)


def test_the_seed_is_told_though_the_problem_file_names_none(told):
    result, job, _ = told
    assert job["run"]["seed"] == result.seed == 1
