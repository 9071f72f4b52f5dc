"""Every example, on real processes and in the simulator: the same run, bit for bit."""

import functools
import hashlib
import itertools
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import supernode
from genetics import Keys
from node.plan import Plan
from node.simulation import simulate
from problems.robot_path.coding_kernels import Collisions
from spy.past import best_known

EXAMPLES = Path(__file__).parent.parent.parent / "examples"
PROBLEMS = sorted(path.name for path in EXAMPLES.glob("*.toml"))
SLOW = "robot-path"  # an individual takes milliseconds there, not microseconds: fewer of them, and fewer generations
TORI = ["torus 4x4", "torus 3x5"]
load = functools.cache(supernode.load)  # to make the spheres of a mesh takes a second


@pytest.fixture(scope="module", params=TORI)
def cluster(request):
    with supernode.LocalCluster(topology=request.param) as cluster:
        yield cluster


def simulated(file):
    digests = [report.digest for report in simulate(Plan.of(file))]
    return hashlib.sha256(b"".join(digests)).hexdigest()


@pytest.mark.parametrize("deme", [1, 8])
@pytest.mark.parametrize("name", PROBLEMS)
def test_solve_and_simulate_have_the_same_history(cluster, name, deme):
    file = load(EXAMPLES / name)
    generations = 3 if file.kind == SLOW else 15
    deme = min(deme, 2) if file.kind == SLOW else deme
    topology = cluster.topology.spec
    run = {"seed": TORI.index(topology), "deme": deme, "stall": 8, "generations": generations, "topology": topology}
    result = cluster.submit(file, **run).result()
    assert result.status in ("solved", "stalled", "exhausted", "optimal")
    assert result.history_sha256 == simulated(file.with_run(**run))
    assert result.messages["lost"] == result.messages["rejected"] == 0


@pytest.mark.parametrize("name", PROBLEMS)
def test_as_it_stands_it_is_solved_and_accepted_in_lockstep_and_async(cluster, name):
    file = load(EXAMPLES / name)
    if file.kind == SLOW:  # its paths get shorter for many seconds; that they do is tested with the planner
        file = file.with_run(stall=2)
    topology = cluster.topology.spec
    mode = ("lockstep", "async")[TORI.index(topology)]
    result = cluster.submit(file, mode=mode, topology=topology).result()
    if mode == "lockstep":
        assert result.feasible
        assert (result.status == "solved") == (result.target is not None)
    assert result.status in ("solved", "stalled", "optimal"), result.message


def test_the_ur5_hits_something_on_each_straight_line_to_a_goal():
    problem = load(EXAMPLES / "ur5-bin.toml").problem()
    collisions = Collisions(problem.scene)
    assert collisions.gap(problem.start, 0.01) > problem.clearance
    for goal in problem.ends:
        assert collisions.gap(goal, 0.01) > problem.clearance
        assert min(collisions.gap(each, 0.01) for each in np.linspace(problem.start, goal, 60)) == 0.0


def test_the_office_is_crossed_in_19_of_20_seeds_and_check_accepts():
    file = supernode.load(EXAMPLES / "mobile-robot.toml")
    problem = file.problem()
    solved = 0
    for seed in range(1, 21):
        reports = simulate(Plan.of(file.with_run(seed=seed)))
        best = best_known(reports, "champion")
        if best.fitness == 0.0:
            verdict = problem.check(problem.decode(np.frombuffer(best.genome, np.uint8)))
            assert (verdict.fitness, verdict.objections) == (0.0, ())
            assert verdict.clearance.least >= 0.0
            solved += 1
    assert solved >= 19


def test_the_shortest_tour_is_found_in_19_of_20_seeds():
    file = supernode.load(EXAMPLES / "inspection_tour.toml")
    problem = file.problem()
    shortest = problem.oracle().fitness
    found = 0
    for seed in range(1, 21):
        best = best_known(simulate(Plan.of(file.with_run(seed=seed))), "champion")
        assert best.fitness >= shortest - 1e-9
        found += best.fitness <= shortest + 1e-9
    assert found >= 19


def test_the_shortest_tour_of_few_points_is_that_of_all_orders():
    file = supernode.load(EXAMPLES / "inspection_tour.toml")
    first, *others = points = file.fields["points"][:7]
    problem = file.changed({"points": points}, {}).problem()
    ways = ((first, *way, first) for way in itertools.permutations(others))
    shortest = min(sum(itertools.starmap(math.dist, itertools.pairwise(way))) for way in ways)
    assert problem.oracle().fitness == pytest.approx(shortest, abs=1e-12)


def test_the_own_coding_keeps_the_rules_of_codings():
    coding = load(EXAMPLES / "own_coding.toml").problem().coding
    recipe, cells, seed = supernode.Recipe("two-point", 0.1), np.array([3, 0, 99]), np.uint64((1 << 64) - 1)
    demes = coding.random(Keys(cells, seed, 0), 6)
    couples = demes.reshape(3, 3, 2, coding.genome_bytes)
    before, offspring = couples.copy(), coding.recombine(couples, recipe, Keys(cells, seed, 5))
    np.testing.assert_array_equal(couples, before)
    for row, cell in enumerate(cells):
        alone = [Keys(np.array([cell]), seed, generation) for generation in (0, 5)]
        np.testing.assert_array_equal(coding.random(alone[0], 6)[0], demes[row])
        np.testing.assert_array_equal(coding.recombine(couples[row : row + 1], recipe, alone[1])[0], offspring[row])
    assert len({genome.tobytes() for genome in offspring.reshape(18, -1)}) == 18
    assert all(map(coding.alphabet.admits, [*demes.reshape(18, -1), *offspring.reshape(18, -1)]))
    for wrong in (supernode.Recipe("one-point"), supernode.Recipe("two-point", "one-bit")):
        with pytest.raises(ValueError, match="moves cross by 'two-point' and mutate with a probability"):
            coding.check(wrong)


def test_the_docs_show_the_own_coding_as_it_is():
    source = (EXAMPLES / "own_coding.py").read_text()
    shown = source[source.index("class Moves:") : source.index("    def mutate_one")].strip()
    assert shown in (EXAMPLES.parent / "docs" / "own-problem.md").read_text()


@pytest.mark.parametrize(("script", "says"), [("own_problem.py", "solved after "), ("inspection_tour.py", "[0, ")])
def test_own_problems_run_as_scripts(script, says):
    done = subprocess.run(
        [sys.executable, str(EXAMPLES / script)], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1].startswith(says)
