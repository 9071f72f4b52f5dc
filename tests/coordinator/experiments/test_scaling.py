"""Scaling experiments: which runs there are, the journal, real runs on small tori, and what is concluded."""

import json
import os
import re
import signal
from html.parser import HTMLParser
from types import SimpleNamespace

import pyarrow.csv
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st

import supernode
import topologies
from coordinator import ClusterFailed, LocalCluster
from coordinator.experiments import measure
from coordinator.experiments import runner as running
from coordinator.experiments.describe import describe
from coordinator.experiments.experiment import all_cases, cases_on, design, points, sequential_cases
from coordinator.experiments.journal import Journal
from coordinator.experiments.outputs import as_json, as_words, write_all
from coordinator.experiments.runner import Runner
from coordinator.experiments.summary import (
    INDEPENDENT,
    STRONG_CPU,
    STRONG_EVALUATIONS,
    WEAK_BALANCE,
    WEAK_TWIN,
    summarise,
)
from coordinator.experiments.words import verdict
from spy.improvement_records import ImprovementRecord
from topologies import torus_of

LOCKSTEP = {"series": ("growing-population",), "modes": ("lockstep",)}
ONE_CURVE = LOCKSTEP | {"nodes": (2,), "seeds": 2, "sequential": (4,)}
SMALL = {"nodes": (4, 6), "repeats": 2, "seeds": 2, "sequential": (4, 8), "demes": (2,), "evaluations": 20_000}


@pytest.fixture
def file(own_problem):
    return supernode.load(own_problem("size = 24"))


def journal_of(folder, file, parameters):
    return Journal(folder, describe(file, parameters))


# Which runs there are -------------------------------------------------------------------------------------------------
@given(st.integers(1, 5000))
def test_the_torus_of_a_size_is_the_most_square(nodes):
    torus = topologies.parse(torus_of(nodes))
    assert torus.cells == nodes
    assert all(nodes % rows for rows in range(torus.rows + 1, int(nodes**0.5) + 1))


def test_the_usual_sizes():
    wanted = {16: "4x4", 64: "8x8", 128: "8x16", 256: "16x16", 1024: "32x32", 7: "1x7"}
    assert {nodes: torus_of(nodes) for nodes in wanted} == {nodes: f"torus {shape}" for nodes, shape in wanted.items()}


def test_series_divide_or_multiply_the_population(file):
    parameters = design(file, nodes=(16, 64), demes=(1, 4), repeats=3, seeds=3)
    assert (parameters.population, parameters.budget) == (64, 128 * 64)
    found = {(point.series, point.nodes, point.deme) for point in points(parameters)}
    assert found == {
        *(("fixed-population", nodes, 64 // nodes) for nodes in (16, 64)),
        *(
            (series, nodes, deme)
            for series in ("growing-population", "budget")
            for nodes in (16, 64)
            for deme in (1, 4)
        ),
    }


def test_a_run_that_two_series_need_is_made_once(file):
    parameters = design(file, nodes=(16, 64), repeats=3, seeds=3, modes=("lockstep",))
    # weak and strong share deme 1 on 64 nodes
    assert len(cases_on(parameters, 64)) == 3 * 2
    assert len(cases_on(parameters, 16)) == 3 * 3
    assert len(cases_on(parameters, 16, "twin")) == 3 * 2
    cases = list(all_cases(parameters))
    assert len({case.key for case in cases}) == len(cases)
    assert [case.seed for case in cases_on(parameters, 64)] == [1, 1, 2, 2, 3, 3]


def test_the_sequential_algorithm_has_the_same_limit_and_none_of_the_nodes_own(file):
    parameters = design(file, nodes=(4,), generations=9, stall=5, interval=3, mutation=0.1)
    sequential = sequential_cases(parameters)[0].file(file, parameters).run
    nodes = cases_on(parameters, 4)[0].file(file, parameters).run
    assert (sequential.topology, sequential.generations, sequential.stall, sequential.interval) == (
        "torus 1x1",
        None,
        None,
        1,
    )
    assert (nodes.generations, nodes.stall, nodes.interval) == (9, 5, 3)
    assert sequential.evaluations == nodes.evaluations
    assert sequential.mutation == nodes.mutation == 0.1


def test_the_files_own_settings_hold_unless_others_are_given(own_problem):
    file = supernode.load(own_problem("[run]", 'topology = "torus 9x9"', "deme = 3", "target = 2.0", "stall = 7"))
    parameters = design(file, nodes=(4,), stall=8)
    assert parameters.demes == (3,)
    assert parameters.run == {"target": 2.0, "stall": 8}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"nodes": (0,)}, "--nodes: expected whole numbers from 1 to 4096, found 0"),
        ({"nodes": (5000,)}, "--nodes: expected whole numbers from 1 to 4096, found 5000"),
        ({"nodes": ()}, "--nodes: expected at least one"),
        ({"repeats": 0}, "--repeats: expected whole numbers from 1, found 0"),
        ({"demes": (0, 1)}, "--demes: expected whole numbers from 1, found 0"),
        ({"population": 7}, "--population: expected a multiple of 4 nodes, found 7"),
        ({"budget": 3}, "--budget: expected at least the first generation of"),
        ({"budget": 0}, "--budget: expected whole numbers from 1, found 0"),
        ({"evaluations": 3}, "--evaluations: expected at least the first generation of"),
        ({"emigrants": 3}, "emigrants: expected at most the deme"),
        ({"recipe": "best"}, "recipe"),
    ],
)
def test_wrong_parameters_are_found_before_anything_is_launched(file, wrong, message):
    with pytest.raises(supernode.BadInput, match=re.escape(message)):
        design(file, **SMALL | wrong)


# The journal ----------------------------------------------------------------------------------------------------------
def test_a_journal_goes_on_where_it_was_and_drops_a_torn_line(file, tmp_path):
    parameters = design(file, **SMALL)
    record = {"type": "run", "key": "one", "status": "solved"}
    with journal_of(tmp_path / "x", file, parameters) as journal:
        journal.append(record)
    path = tmp_path / "x" / "runs.jsonl"
    whole = path.read_bytes()
    for torn in (b'{"type": "run", "key": "tw', b'{"type": "run"\n', b"\0\0\0"):
        path.write_bytes(whole + torn)
        with journal_of(tmp_path / "x", file, parameters) as journal:
            assert journal.runs == {"one": record}
            journal.append({"type": "launch", "nodes": 4, "seconds": 1.0})
        assert len(path.read_text().splitlines()) == 2
        path.write_bytes(whole)


def test_a_broken_line_in_the_middle_is_an_error(file, tmp_path):
    parameters = design(file, **SMALL)
    journal_of(tmp_path, file, parameters).__exit__()
    (tmp_path / "runs.jsonl").write_text('{"type": "launch"}\nrubbish\n{"type": "launch"}\n')
    with pytest.raises(supernode.BadInput, match="expected one JSON object in line 2"):
        journal_of(tmp_path, file, parameters)


def test_another_experiment_in_the_folder_is_named(file, own_problem, tmp_path):
    journal_of(tmp_path / "x", file, design(file, **SMALL)).__exit__()
    with pytest.raises(supernode.BadInput, match=r"\(there / here\): repeats 2 / 3; run\.target not given / 1\.0$"):
        journal_of(tmp_path / "x", file, design(file, **SMALL | {"repeats": 3, "target": 1.0}))
    other = supernode.load(own_problem("size = 25", name="other.toml"))
    with pytest.raises(supernode.BadInput, match=r"problem\.sha256"):
        journal_of(tmp_path / "x", other, design(other, **SMALL))
    (tmp_path / "x" / "experiment.json").unlink()
    (tmp_path / "x" / "runs.jsonl").write_text("{}\n")
    with pytest.raises(supernode.BadInput, match=r"found runs\.jsonl without experiment\.json"):
        journal_of(tmp_path / "x", file, design(file, **SMALL))


def test_one_process_at_a_time(file, tmp_path):
    parameters = design(file, **SMALL)
    with journal_of(tmp_path, file, parameters), pytest.raises(supernode.BadInput, match="still running"):
        journal_of(tmp_path, file, parameters)


# Real runs ------------------------------------------------------------------------------------------------------------
def test_cpu_time_by_process_is_what_is_summed():
    with LocalCluster(torus=(1, 2)) as cluster:
        before, used, after = cluster.cpu_seconds(), cluster.cpu_seconds_by_process(), cluster.cpu_seconds()
        assert set(used) == {*cluster.processes, "zygote", "coordinator"}
    assert before <= sum(used.values()) <= after


def test_evaluations_to_the_target_are_those_of_the_first_that_the_cells_noted():
    noted = [ImprovementRecord(0, generation, 0, 16 * generation, 8.0 - generation) for generation in range(9)]
    result = SimpleNamespace(solved=True, target=3.0, evaluations=200)
    assert measure._evaluations_to_target(result, noted) == 80
    result.evaluations = 70  # async: no cell but the finder's came to that generation
    assert measure._evaluations_to_target(result, noted) == 70
    result.solved = False
    assert measure._evaluations_to_target(result, noted) is None


def test_an_experiment_from_end_to_end(file, tmp_path):
    parameters = design(file, **SMALL)
    with journal_of(tmp_path, file, parameters) as journal:
        said = []
        Runner(file, parameters, journal, said.append).run()
        launches = len(journal.of_type("launch"))
        Runner(file, parameters, journal, said.append).run()  # nothing is left to do
        assert len(journal.of_type("launch")) == launches == 2
        assert journal.runs.keys() == {case.key for case in all_cases(parameters)}
        _check_records(journal)
        summary = summarise(parameters, journal)
        write_all(summary, journal)
    assert summary.replayed == (8, 8)
    assert summary.failed == []
    _check_files(tmp_path, summary)


def _check_records(journal):
    assert [record["nodes"] for record in journal.of_type("memory")] == [4, 6]
    assert all(1e6 < record["bytes"] < 1e9 for record in journal.of_type("memory"))
    for run in journal.runs.values():
        assert run["status"] in ("solved", "exhausted")
        assert 0 < run["critical_cpu_seconds"] <= run["node_cpu_seconds"] <= run["cpu_seconds"] + 1e-6
        assert run["messages_lost"] == 0
        if run["role"] == "nodes":
            assert run["messages_sent"] > 0
            assert run["seconds_to_target"] is None or 0 <= run["seconds_to_target"] <= run["seconds"] + 0.5
        if run["solved"]:
            assert 0 < run["evaluations_to_target"] <= run["evaluations"]
    reached = {"nodes": {}, "twin": {}}
    for run in journal.runs.values():
        if run["role"] in reached and run["mode"] == "lockstep":
            same = tuple(run[name] for name in ("nodes", "deme", "goal", "seed"))
            reached[run["role"]][same] = run["evaluations_to_target"]
    assert any(reached["twin"].values())
    assert reached["twin"].items() <= reached["nodes"].items(), "whatever the spy heard, and when"
    for seed in (1, 2):
        assert journal.runs[f"nodes 6 lockstep deme 2 to budget seed {seed}"]["evaluations"] <= 128 * 24


def _check_files(folder, summary):
    table = pyarrow.parquet.read_table(folder / "runs.parquet")
    assert table.num_rows == len(summary.runs) == pyarrow.csv.read_csv(folder / "runs.csv").num_rows
    assert set(table.column("role").to_pylist()) == {"nodes", "twin", "sequential"}
    assert pyarrow.csv.read_csv(folder / "summary.csv").num_rows == len(summary.rows)
    pictures = sorted(folder.glob("*.png"))
    assert len(pictures) == len(list(folder.glob("*.svg"))) == 8
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in pictures)
    _check_report((folder / "report.html").read_text(), len(pictures))
    assert json.loads(as_json(summary, folder))["verdict"] == verdict(summary)
    assert "fixed-population, async" in as_words(summary, folder)


class _Sources(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attributes):
        self.found += [value for name, value in attributes if name in ("src", "href")]


def _check_report(page, pictures):
    sources = _Sources()
    sources.feed(page)
    assert len(sources.found) == pictures
    assert all(source.startswith("data:image/png;base64,") for source in sources.found)
    said = ("Critical-path CPU time is", "best sequential algorithm", "super-linear", "supernode scale", "size = 24")
    for words in said:
        assert words in page


# Failures -------------------------------------------------------------------------------------------------------------
def deadly(monkeypatch, *deadly_runs):
    """Let a node die just before the runs of these numbers (each launch begins with two of no generation)."""
    original, count = running.run_on_nodes, [0]

    def run(cluster, *arguments):
        count[0] += 1
        if count[0] in deadly_runs:
            os.kill(cluster.processes["node 1"], signal.SIGKILL)
        return original(cluster, *arguments)

    monkeypatch.setattr(running, "run_on_nodes", run)


def test_a_dead_cluster_is_recorded_and_the_experiment_goes_on(file, tmp_path, monkeypatch):
    parameters = design(file, **ONE_CURVE, repeats=2)
    deadly(monkeypatch, 3)
    with journal_of(tmp_path, file, parameters) as journal:
        Runner(file, parameters, journal, lambda _: None).run()
        assert len(journal.of_type("launch")) == 2
        failures = [run for run in journal.runs.values() if run["status"] == "failed"]
        assert len(failures) + len(journal.of_type("failure")) == 1
        Runner(file, parameters, journal, lambda _: None).run()  # makes again what failed
        assert {run["status"] for run in journal.runs.values()} == {"solved"}


def test_two_failures_in_a_row_end_the_experiment(file, tmp_path, monkeypatch):
    parameters = design(file, **ONE_CURVE, repeats=3)
    deadly(monkeypatch, 3, 6)
    with (
        journal_of(tmp_path, file, parameters) as journal,
        pytest.raises(ClusterFailed, match="2 nodes failed 2 times in a row, at last: node 1"),
    ):
        Runner(file, parameters, journal, lambda _: None).run()


# What is concluded ----------------------------------------------------------------------------------------------------
def invented(parameters, cost):
    """A journal of runs without running: ``cost`` gives evaluations and critical CPU seconds of a case, or None."""

    runs = {}
    for case in all_cases(parameters):
        paid = cost(case)
        evaluations, cpu = paid or (parameters.evaluations, 9.0)
        runs[case.key] = {
            "key": case.key,
            "role": case.role,
            "nodes": case.nodes,
            "status": "solved" if paid else "exhausted",
            "solved": paid is not None,
            "fitness": 0.0 if paid else None,
            "generations": 10,
            "evaluations": evaluations,
            "evaluations_to_target": evaluations if paid else None,
            "seconds": 1.0,
            "seconds_to_target": 1.0 if paid else None,
            "cpu_seconds": cpu,
            "node_cpu_seconds": cpu * case.nodes,
            "critical_cpu_seconds": cpu,
            "messages_sent": 10 * case.nodes,
            "messages_received": 40 * case.nodes,
            "messages_lost": 0,
            "staleness_mean": None,
            "history_sha256": "x",
        }
    return SimpleNamespace(runs=runs, of_type=lambda _: [])


def concluded(file, cost, **changes):
    parameters = design(file, **LOCKSTEP | {"nodes": (4, 16), "repeats": 25, "seeds": 25} | changes)
    return summarise(parameters, invented(parameters, cost))


def values(summary, metric):
    (curve,) = summary.curves()
    return {row.nodes: row.estimate.value for row in summary.find(metric, curve)}


def test_speed_ups_as_computed_by_hand(file):
    costs = {"sequential": (1600, 8.0), "twin": (800, 4.0)}
    summary = concluded(file, lambda case: costs.get(case.role, (800, 2.0)))
    assert values(summary, STRONG_EVALUATIONS) == pytest.approx({4: 1600 / (800 / 4), 16: 1600 / (800 / 16)})
    assert values(summary, STRONG_CPU) == {4: 4.0, 16: 4.0}
    assert values(summary, WEAK_TWIN) == {4: 2.0, 16: 2.0}
    assert values(summary, WEAK_BALANCE) == {4: 4.0, 16: 16.0}
    assert {(row.metric.name, row.nodes) for row in summary.super_linear()} == {
        ("strong_speedup_evaluations", 4),
        ("strong_speedup_evaluations", 16),
    }
    said = verdict(summary)
    assert said[0].startswith("Strong speed-up, in evaluations: super-linear speed-up is shown: growing-population, ")
    assert said[1].startswith("Quotients of CPU times compare programs")
    assert values(summary, INDEPENDENT) == {4: 1.0, 16: 1.0}, "who always needs the same gains nothing by repetition"


def test_the_best_sequential_algorithm_succeeds_most_often_and_is_cheapest_then(file):
    def cost(case):
        if case.role != "sequential":
            return 800, 2.0
        if case.deme == 16:  # cheap, but fails once
            return None if case.seed == 3 else (100, 0.1)
        return (1600, 9.0) if case.deme == 64 else (3200, 8.0)

    summary = concluded(file, cost)
    assert {each.deme: each.best_for for each in summary.sequential} == {
        16: (),
        64: ("evaluations",),
        256: ("CPU time",),
    }
    assert values(summary, STRONG_EVALUATIONS)[4] == pytest.approx(8.0)
    assert values(summary, STRONG_CPU)[4] == 4.0


def test_speed_up_is_not_told_where_most_runs_fail(file):
    summary = concluded(file, lambda case: None if case.role != "sequential" and case.seed < 14 else (800, 2.0))
    assert values(summary, STRONG_EVALUATIONS) == {}
    assert values(summary, STRONG_CPU) == {}


def test_an_interval_that_reaches_one_is_not_super_linear(file):
    def cost(case):
        if case.role == "sequential":
            return 1600, 2.0
        return (800 if case.seed > 11 else 1_600_000), 2.0

    summary = concluded(file, cost)
    assert values(summary, STRONG_EVALUATIONS)[4] == pytest.approx(8.0)
    assert summary.super_linear() == []
    assert "super-linear speed-up is undecided" in verdict(summary)[0]


def test_few_seeds_decide_nothing(file):
    costs = {"sequential": (1600, 8.0)}
    summary = concluded(file, lambda case: costs.get(case.role, (800, 2.0)), repeats=3, seeds=3)
    assert "super-linear speed-up is undecided" in verdict(summary)[0]
    assert "about 20 seeds would decide" in verdict(summary)[0]
