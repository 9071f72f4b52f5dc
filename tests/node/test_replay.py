"""A job through several epochs in this process: the same as its epochs one by one, and nothing wrong is let in."""

import dataclasses
import hashlib

import numpy as np
import pytest

from node.plan import Plan
from node.replay import epochs_of, replay
from node.simulation import simulate
from problems import BadInput, EvaluationFailed, load

FUNCTION = """
kind = "function"
name = "rastrigin"
dimension = 4

[run]
topology = "torus 2x3"
deme = 5
seed = 11
target = -1.0
generations = 60
"""
UPDATE = {"epoch": 1, "do": "update", "generation": 12, "fields": {"name": "sphere"}}
REWIRE = {"epoch": 2, "do": "rewire", "generation": 7, "topology": "ring 6"}
REPLACE = {
    "epoch": 3,
    "do": "replace",
    "generation": 5,
    "demes_of": {"4": 3},
    "generations": {"0": 6, "1": 5, "2": 5, "3": 4, "5": 4},
}
STOP = {"do": "stop", "generation": 9, "reason": "cancel"}
TURNS = [UPDATE, REWIRE, REPLACE]


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "function.toml"
    path.write_text(FUNCTION)
    return load(path)


def digests(reports):
    return [report.digest for report in reports]


def demes_of(reports, deme=5):
    return np.stack([np.frombuffer(report.deme, np.uint8).reshape(deme, -1) for report in reports])


def plan_of(file, epoch=0, since=0, **run):
    return Plan.of(file.with_run(**run), epoch, since)


def test_without_directives_it_is_a_plain_run(file):
    (lived,) = replay(file)
    assert digests(lived.reports) == digests(simulate(Plan.of(file)))
    assert (lived.file, lived.why) == (file, {})
    assert (lived.plan.epoch, lived.plan.since) == (0, 0)


@pytest.mark.parametrize("stops", [[STOP], [STOP, STOP | {"generation": 30}], [STOP | {"generation": 30}, STOP]])
def test_a_stop_is_a_limit_of_generations(file, stops):
    (lived,) = replay(file, stops)
    assert digests(lived.reports) == digests(simulate(plan_of(file, generations=9)))
    assert {report.generation for report in lived.reports} == {9}
    assert lived.plan.run.generations == 60, "what is judged is the run that was asked for"


def test_an_update_goes_on_with_the_demes_in_an_epoch_of_its_own(file):
    first, second = replay(file, [UPDATE])
    by_hand = simulate(plan_of(file, generations=12))
    assert digests(first.reports) == digests(by_hand)
    after = file.changed({"name": "sphere"}, {})
    then = simulate(Plan.of(after, 1, 12), demes=demes_of(by_hand))
    assert digests(second.reports) == digests(then)
    assert {report.generation for report in second.reports} == {60 - 12}, "a limit is on the job's generations"
    assert (second.file.fields["name"], second.why) == ("sphere", UPDATE)
    assert digests(simulate(Plan.of(after, 0, 12), demes=demes_of(by_hand))) != digests(then), "numbers of its own"


def test_update_rewire_and_replacement_are_a_chain_of_runs(file):
    lived = replay(file, [*TURNS, STOP])
    after = file.changed({"name": "sphere"}, {})
    ring = after.with_run(topology="ring 6")
    one = simulate(plan_of(file, generations=12))
    two = simulate(plan_of(after, 1, 12, generations=12 + 7), demes=demes_of(one))
    kept = {}

    def see(generation, genomes, _):
        for cell, left in REPLACE["generations"].items():
            if left == generation:
                kept[int(cell)] = genomes[int(cell)].copy()

    three = simulate(plan_of(ring, 2, 19, generations=19 + 6), snapshot=see, demes=demes_of(two))
    kept[4] = kept[3]
    four = simulate(plan_of(ring, 3, 25, generations=25 + 9), demes=np.stack([kept[cell] for cell in range(6)]))
    assert [digests(each.reports) for each in lived] == [digests(each) for each in (one, two, three, four)]
    assert [each.plan.topology.spec for each in lived] == ["torus 2x3", "torus 2x3", "ring 6", "ring 6"]
    assert [(each.plan.epoch, each.plan.since) for each in lived] == [(0, 0), (1, 12), (2, 19), (3, 25)]
    assert [each.why for each in lived] == [{}, *TURNS]


def test_the_same_directives_give_the_same_run_and_others_another(file):
    def history(*directives):
        return hashlib.sha256(b"".join(d for each in replay(file, directives) for d in digests(each.reports))).digest()

    once = history(*TURNS)
    assert history(*TURNS) == once
    others = [
        TURNS[:2],
        [UPDATE | {"generation": 13}, *TURNS[1:]],
        [UPDATE | {"fields": {"name": "rastrigin"}}, *TURNS[1:]],
        [UPDATE, REWIRE | {"topology": "complete 6"}, REPLACE],
        [UPDATE, REWIRE, REPLACE | {"demes_of": {"4": 5}}],
        [REWIRE, UPDATE, REPLACE],
    ]
    assert once not in {history(*directives) for directives in others}


def test_an_update_right_at_the_beginning_hands_on_the_first_demes(file):
    first, second = replay(file, [UPDATE | {"generation": 0}])
    assert {report.generation for report in first.reports} == {0}
    assert digests(second.reports) == digests(
        simulate(Plan.of(second.file, 1), demes=demes_of(simulate(plan_of(file, generations=0))))
    )


def test_only_the_last_epoch_is_watched_and_asked_whether_to_stop(file):
    seen, asked = [], []

    def outside():
        asked.append(True)
        return "cancel" if len(asked) == 4 else None

    first, second = replay(file, [UPDATE], lambda generation, champion: seen.append((generation, champion)), outside)
    assert {report.generation for report in first.reports} == {12}
    assert {report.generation for report in second.reports} == {3 + second.plan.stop_distance}
    assert seen[0][0] == 0
    assert seen[-1][1] == second.reports[0].champion, "of what the root knows"


def test_epochs_are_known_before_anything_runs(file):
    epochs = epochs_of(file, (*TURNS, STOP))
    assert [each.since for each in epochs] == [0, 12, 19, 25]
    assert [each.last for each in epochs] == [12, 7, 6, 9]
    assert epochs[-1].file.sha256 == file.changed({"name": "sphere"}, {}).sha256


def test_a_problem_that_breaks_in_a_later_epoch_says_so(own_problem):
    file = load(own_problem("[run]", 'topology = "torus 2x2"', "target = -1.0", "generations = 40"))
    with pytest.raises(EvaluationFailed, match="evaluate raised RuntimeError: out of paper"):
        replay(file, [{"do": "update", "generation": 3, "fields": {"trouble": "raises"}}])


RETRY = {"epoch": 1, "do": "retry", "generation": 12, "attempt": 1, "seed": 7, "fields": {"dimension": 5}}


def test_another_attempt_begins_with_new_individuals_and_a_seed_of_its_own(file):
    first, second, third = replay(file, [RETRY, UPDATE | {"epoch": 2, "generation": 7}])
    assert digests(first.reports) == digests(simulate(plan_of(file, generations=12)))
    alone = {"seed": int(second.plan.seed), "generations": 7}
    longer = dataclasses.replace(file, fields=file.fields | {"dimension": 5})
    assert digests(second.reports) == digests(simulate(plan_of(longer, **alone))), "as if it were the first"
    assert (second.plan.attempt, second.plan.since, second.file.sha256) == (1, 12, file.sha256)
    assert (third.plan.attempt, third.plan.since, third.plan.problem.dimension) == (0, 19, 5)


def test_the_directive_of_an_attempt_tells_its_seed(file):
    first = epochs_of(file)[0]
    second = first.retried(12, {"dimension": 5})
    assert second.why == {"do": "retry", "attempt": 1, "seed": int(second.plan.seed), "fields": {"dimension": 5}}
    assert (second.number, second.since, second.is_fresh, first.is_fresh) == (1, 12, True, False)
    third = second.retried(7, {})
    assert (third.number, third.since, third.why["attempt"], third.plan.problem.dimension) == (2, 19, 2, 5)


def without(directive, name):
    return {key: value for key, value in directive.items() if key != name}


@pytest.mark.parametrize(
    ("directive", "said"),
    [
        ({}, "do: expected stop, infeasible, update, rewire, replace, resume or retry, found null"),
        ({"do": "dance"}, 'do: expected stop, infeasible, update, rewire, replace, resume or retry, found "dance"'),
        ({"do": ["stop"]}, "do: expected stop, infeasible, update, rewire, replace, resume or retry, found ["),
        ("stop", 'expected tables, found "stop"'),
        (None, "expected tables, found null"),
        (without(STOP, "generation"), "generation: expected a whole number from 0 on, found null"),
        (STOP | {"generation": -1}, "generation: expected a whole number from 0 on, found -1"),
        (without(UPDATE, "generation"), "generation: expected a whole number from 0 on, found null"),
        (UPDATE | {"generation": 1.5}, "generation: expected a whole number from 0 on, found 1.5"),
        (UPDATE | {"generation": True}, "generation: expected a whole number from 0 on, found true"),
        (without(UPDATE, "fields"), "fields: expected a table, found null"),
        (UPDATE | {"fields": [1]}, "fields: expected a table, found [1]"),
        (without(REWIRE, "topology"), "topology: expected a text, found null"),
        (without(RETRY, "fields"), "fields: expected a table, found null"),
        (without(RETRY, "generation"), "generation: expected a whole number from 0 on, found null"),
        (REWIRE | {"topology": "ring 7"}, 'topology: expected one of 6 cells, found "ring 7"'),
        (without(REPLACE, "demes_of"), "demes_of: expected a table, found null"),
        (without(REPLACE, "generations"), "generations: expected a table, found null"),
        (
            REPLACE | {"generations": {"0": 3, "1": 3}},
            "generations: expected one for each cell, found none for [2, 3, 5]",
        ),
        (REPLACE | {"generations": {}, "demes_of": {str(cell): 0 for cell in range(6)}}, "generations: expected one"),
        (
            REPLACE | {"generations": REPLACE["generations"] | {"6": 1}},
            'generations: expected a cell below 6, found "6"',
        ),
        (
            REPLACE | {"generations": REPLACE["generations"] | {"x": 1}},
            'generations: expected a cell below 6, found "x"',
        ),
        (
            REPLACE | {"generations": REPLACE["generations"] | {"0": -1}},
            "0: expected a whole number from 0 on, found -1",
        ),
        (
            REPLACE | {"topology": "torus 3x3"},
            "demes_of: expected one for each further cell, found none for [6, 7, 8]",
        ),
        (REPLACE | {"topology": "torus 1x3"}, 'topology: expected one of 6 cells, found "torus 1x3"'),
        (REPLACE | {"demes_of": {"4": 6}}, "demes_of: expected dead cells, each with a living one"),
        (REPLACE | {"demes_of": {"4": 4}}, "demes_of: expected dead cells, each with a living one"),
        (REPLACE | {"demes_of": {"4": 3, "0": 1}}, "demes_of: expected dead cells, each with a living one"),
    ],
)
def test_wrong_directives_are_refused_before_anything_runs(file, directive, said):
    with pytest.raises(BadInput) as caught:
        epochs_of(file, [UPDATE, directive])
    assert str(caught.value).startswith("directives: ")
    assert said in str(caught.value)


def test_a_torus_that_grows_gives_the_further_cells_the_demes_of_others(file):
    donors = {"6": 0, "7": 1, "8": 2}
    grown = REPLACE | {"demes_of": donors, "generations": dict.fromkeys("012345", 5), "topology": "torus 3x3"}
    lived = replay(file.with_run(topology="torus 2x3"), [grown | {"epoch": 1}])
    one = simulate(plan_of(file.with_run(topology="torus 2x3"), generations=5))
    demes = demes_of(one)[[*range(6), *donors.values()]]
    two = simulate(plan_of(file.with_run(topology="torus 3x3"), 1, 5), demes=demes)
    assert [digests(each.reports) for each in lived] == [digests(one), digests(two)]


def test_an_update_to_an_impossible_world_is_refused_as_it_is_in_a_run(file):
    with pytest.raises(BadInput, match=r'function.toml: name: expected .*, found "flat"'):
        replay(file, [UPDATE | {"fields": {"name": "flat"}}])
    with pytest.raises(BadInput, match="the update would change how individuals are coded"):
        replay(file, [UPDATE | {"fields": {"dimension": 5}}])


def test_an_epoch_that_ends_before_it_was_left_is_of_another_run(file):
    with pytest.raises(BadInput, match="leave after generation 12, but epoch 0 ends after generation 3 already"):
        replay(file.with_run(target=1e9), [UPDATE])


def test_async_epochs_cannot_be_repeated(file):
    with pytest.raises(BadInput, match="mode: expected lockstep, which alone can be repeated, found async"):
        replay(file.with_run(mode="async"), [UPDATE])


def test_the_seed_of_each_epoch_is_another(file):
    plans = [Plan.of(file, epoch) for epoch in range(100)]
    assert plans[0].seed == 11
    assert len({int(plan.seed) for plan in plans}) == 100
    assert dataclasses.replace(plans[3], since=9).seed == plans[3].seed
