"""Events in, the exact actions out; no cluster, no clock."""

import dataclasses

import numpy as np
import pytest
from exchanges import Emigrant, decode
from one_max import Bus, OneMax, plan_of

from node.cell import Cell
from node.events import Answer, Answered, Ask, Asked, Complain, Halt, Propose, Publish, Start, Waited
from node.plan import Plan
from problems import Run
from wire.champion import Champion
from wire.exchange import NEVER
from wire.report import Report


def said(plan, published):
    """The message that is published."""
    assert isinstance(published, Publish)
    return decode(published, plan.limits)


def message_of(plan, cell, **changes):
    """What ``cell`` says in generation 0."""
    published, *_ = Cell(plan, cell, job=1).step(events=[Start()])
    return dataclasses.replace(said(plan, published), **changes)


def heard(plan, senders, **changes):
    return [(sender, message_of(plan, sender, **changes).encode()) for sender in senders]


def started(plan, cell=0):
    """A running cell, and what it published when it began."""
    cell = Cell(plan, cell, job=1)
    return cell, *cell.step(events=[Start()])


def test_before_start_it_only_listens():
    plan = plan_of()
    cell = Cell(plan, 5, job=1)
    assert cell.neighbours == (1, 6, 9, 4)
    assert cell.step(heard(plan, cell.neighbours)) == []
    assert (cell.state, cell.missing_count) == ("prepared", NEVER)
    first, second = cell.step(events=[Start()])
    assert [said(plan, each).generation for each in (first, second)] == [0, 1]


def test_start_publishes_the_first_generation_and_waits():
    plan = plan_of()
    cell, published = started(plan)
    message = said(plan, published)
    assert (message.job, message.epoch, message.generation, message.stop_at) == (1, 0, 0, None)
    assert (message.sent, message.evaluations) == (1, 1)
    (emigrant,) = message.emigrants
    assert message.champion == cell.champion == Champion(emigrant.fitness, 0, 0, emigrant.genome)
    assert cell.missing_count == 4
    assert cell.step() == []
    assert cell.step(events=[Start()]) == [], "it begins once"


def test_a_generation_needs_every_neighbour_whatever_the_order():
    plan = plan_of()
    news = heard(plan, (12, 1, 4, 3))
    outcomes = []
    for order in ([0, 1, 2, 3], [3, 1, 0, 2]):
        cell, _ = started(plan)
        for index in order[:-1]:
            assert cell.step([news[index]]) == []
        outcomes.append(cell.step([news[order[-1]]]))
    assert outcomes[0] == outcomes[1]
    (published,) = outcomes[0]
    message = said(plan, published)
    assert message.generation == 1
    assert message.evaluations == 1 + 8


def test_messages_of_another_job_strangers_and_doubles_are_ignored():
    plan = plan_of()
    cell, _ = started(plan)
    other_job = heard(plan, (1,), job=2)
    stranger = [(10, message_of(plan, 10).encode()), (0, message_of(plan, 0).encode())]
    far_future = heard(plan, (1,), generation=99)
    assert cell.step(other_job + stranger + far_future) == []
    assert cell.inbox.kept == 0
    once = heard(plan, (1,))
    cell.step(once + once)
    assert cell.inbox.kept == 1


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_messages_of_another_epoch_are_ignored_and_nobody_complains_of_them(mode):
    plan = dataclasses.replace(plan_of(mode=mode, target=-1.0), epoch=1)
    cell = Cell(plan, 0, job=1)
    assert said(plan, cell.step(events=[Start()])[0]).epoch == 1
    others = [message for epoch in (0, 2) for message in heard(plan, (12, 1, 4, 3), epoch=epoch, stop_at=1)]
    generation = cell.rows.generation
    actions = cell.step(others, [Answered(sender, 0, [payload]) for sender, payload in others])
    assert not any(isinstance(action, Complain) for action in actions)
    assert (cell.inbox.kept, cell.inbox.refused, cell.inbox.of_no_use, cell.lost) == (0, 0, 0, 0)
    assert cell.state == "running", "a stop of another epoch is none here"
    if mode == "lockstep":
        assert actions == []
        assert sorted(cell.inbox.missing_senders()) == [1, 3, 4, 12]
        assert cell.rows.generation == generation
    cell.step(heard(plan, (12, 1, 4, 3)))
    assert cell.inbox.kept == 4
    assert cell.rows.generation > generation


def test_another_epoch_draws_other_random_numbers():
    first = plan_of(size=200, target=-1.0)
    epochs = [first, *(dataclasses.replace(first, epoch=epoch, since=30) for epoch in (1, 2))]
    demes = []
    for plan in epochs:
        cell = Cell(plan, 0, job=1)
        cell.step(events=[Start()])
        demes.append(cell.rows.genomes.tobytes())
    assert len(set(demes)) == 3, "each begins with random individuals of its own"
    deme = np.frombuffer(demes[0], np.uint8).reshape(1, -1)
    bred = []
    for plan in epochs:
        cell = Cell(plan, 0, job=1)
        (published,) = cell.step(events=[Start(deme)])
        assert said(plan, published).emigrants[0].genome == demes[0], "of those that are given"
        same_news = [
            (sender, dataclasses.replace(message_of(first, sender), epoch=plan.epoch)) for sender in (12, 1, 4, 3)
        ]
        cell.step([(sender, message.encode()) for sender, message in same_news])
        assert cell.rows.generation == 1
        bred.append(cell.rows.genomes.tobytes())
    assert len(set(bred)) == 3, "and breeds them otherwise"
    assert dataclasses.replace(first, since=30).seed == first.seed, "however long the job has lived"


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_halt_stops_a_running_cell_at_once_and_leaves_what_it_has_bred(mode):
    plan = plan_of(mode=mode, target=-1.0, deme=3)
    cell = Cell(plan, 0, job=1)
    cell.step(events=[Start()])
    cell.step(heard(plan, (12, 1, 4, 3)))
    generation, deme = cell.rows.generation, cell.rows.genomes.tobytes()
    (report,) = cell.step(events=[Halt()])
    assert isinstance(report, Report)
    assert (report.generation, report.deme, report.error) == (generation, deme, None)
    assert report.proposals == (), "the others are not asked to stop"
    assert cell.state == "stopped"
    assert cell.step(heard(plan, (12, 1, 4, 3), generation=1), [Halt(), Start(), Waited()]) == []


def answers(plan, cell, *questions):
    """What the cell answers, by question; the messages that it says again are without its state."""
    given = cell.step(events=questions)
    return {answer.question: [said(plan, payload) for payload in answer.payloads] for answer in given}


def test_a_cell_that_has_halted_still_answers_neighbours_that_missed_a_message():
    plan = plan_of()
    cell, published = started(plan)
    (report,) = cell.step(events=[Halt()])
    assert report.halted
    assert answers(plan, cell, Asked(0, "q")) == {"q": [said(plan, published)]}


def test_halt_is_nothing_to_a_cell_that_has_not_begun_or_has_ended():
    plan = plan_of(generations=0)
    cell = Cell(plan, 0, job=1)
    assert cell.step(events=[Halt()]) == []
    assert cell.state == "prepared"
    (report,) = cell.step(events=[Start()])
    assert (report.generation, report.halted) == (0, False)
    assert cell.step(events=[Halt()]) == [], "it reports once"


def test_bad_messages_are_complained_of_once_for_each_neighbour_and_reason():
    plan = plan_of()
    cell, _ = started(plan)
    bad, worse = b"", b"\xc0"
    stranger = (10, bad)
    assert cell.step([(1, bad), (4, worse), stranger, (1, bad)]) == [
        Complain(1, "not msgpack"),
        Complain(4, "not an array"),
    ]
    assert cell.step([(1, bad), (1, worse)], [Answered(4, 0, [bad])]) == [
        Complain(1, "not an array"),
        Complain(4, "not msgpack"),
    ]
    assert cell.inbox.refused == 6
    (published,) = cell.step(heard(plan, (12, 1, 4, 3)))
    assert said(plan, published).generation == 1, "it hurts nothing"


def test_it_asks_for_what_is_missing_and_counts_it_as_lost_when_it_is_the_answer_that_comes():
    plan = plan_of()
    cell = Cell(plan, 0, job=1)
    assert cell.step(events=[Waited()]) == [], "nothing is missing before the start"
    cell.step(heard(plan, (12, 4)), [Start()])
    assert cell.step(events=[Waited()]) == [Ask(1, 0), Ask(3, 0)]
    cell.step(events=[Answered(sender, 0, [payload]) for sender, payload in heard(plan, (1, 3))])
    assert cell.rows.generation == 1
    assert cell.lost == 2
    assert cell.step(heard(plan, (1,))) == [], "it had been late only"
    assert (cell.lost, cell.inbox.kept) == (1, 4)
    cell.step(events=[Answered(sender, 0, [payload]) for sender, payload in heard(plan, (3,))])
    assert cell.lost == 1, "to be answered twice finds nothing that was lost"


def test_what_comes_before_the_answer_was_not_lost():
    plan = plan_of()
    cell, _ = started(plan)
    (news,) = heard(plan, (1,))
    cell.step([news])
    cell.step(events=[Answered(1, 0, [news[1]]), Answered(3, 0, [b""])])
    assert (cell.lost, cell.inbox.kept) == (0, 1)


def test_it_answers_with_its_messages_since_a_generation():
    plan = plan_of()
    cell, first = started(plan)
    (second,) = cell.step(heard(plan, (12, 1, 4, 3)))
    one, two = said(plan, first), said(plan, second)
    assert answers(plan, cell, Asked(0, "q"), Asked(1, "r"), Asked(7, "s")) == {"q": [one, two], "r": [two]}
    (third,) = cell.step(heard(plan, (12, 1, 4, 3), generation=1))
    three = said(plan, third)
    questions = Asked(0, "q"), Asked(1, "r"), Asked(2, "s")
    assert answers(plan, cell, *questions) == {"q": [one, two, three], "r": [two, three], "s": [three]}


def test_the_cell_that_bred_the_target_proposes_to_stop():
    plan = plan_of(size=1, mutation=0.0, seed=3)
    cell = next(cell for cell in (Cell(plan, number, 1) for number in range(16)) if _starts_solved(cell))
    assert cell.rows.stop_at[0] == plan.stop_distance == 5
    (proposal,) = cell.rows.proposals
    assert (proposal.reason, proposal.cell, proposal.generation) == ("target", cell.number, 0)


def _starts_solved(cell):
    cell.step(events=[Start()])
    return cell.rows.fitness[0, 0] == 0.0


def test_the_least_stop_wins_and_is_passed_on():
    plan = plan_of(size=40, target=-1.0)
    cell = Cell(plan, 0, job=1)
    cell.step(events=[Start()])
    news = heard(plan, (12, 1, 4)) + heard(plan, (3,), stop_at=4)
    (published,) = cell.step(news)
    assert said(plan, published).stop_at == 4
    cell.step(events=[Propose("cancel")])
    assert cell.rows.stop_at[0] == 4, "a later stop changes nothing"


def test_it_stops_at_the_limit_with_a_report_and_no_further_message():
    plan = plan_of(generations=1, target=-1.0)
    cell = Cell(plan, 0, job=1)
    cell.step(events=[Start()])
    (report,) = cell.step(heard(plan, (12, 1, 4, 3)))
    assert isinstance(report, Report)
    assert (report.generation, report.evaluations, report.sent, report.received) == (1, 9, 1, 4)
    assert report.deme == cell.rows.genomes.tobytes()
    assert cell.state == "stopped"
    assert cell.step(heard(plan, (1,)), [Start(), Propose("cancel"), Waited()]) == []


def test_a_problem_that_breaks_fails_the_cell_with_its_message():
    class Broken(OneMax):
        def evaluate(self, genomes):
            raise RuntimeError("out of paper")

    cell = Cell(Plan(Broken(kind="broken"), Run()), 0, job=1)
    (report,) = cell.step(events=[Start()])
    assert report.error == "broken: evaluate raised RuntimeError: out of paper"
    assert cell.state == "failed"


def test_under_the_papers_spy_champions_do_not_travel_but_to_the_spy():
    plan = plan_of(spy="root")
    assert message_of(plan, 5).champion is None
    assert message_of(plan, 0).champion is not None
    cell = Cell(plan, 1, job=1)
    cell.step(events=[Start()])
    lie = Champion(-5.0, 0, 0, bytes(5))
    cell.step(heard(plan, cell.neighbours, champion=lie))
    assert cell.rows.generation == 1
    assert cell.champion.fitness >= 0.0, "only emigrants are heard of"


def test_in_async_mode_every_step_breeds_and_a_stop_is_passed_on_at_once():
    plan = plan_of(mode="async", target=-1.0)
    cell = Cell(plan, 0, job=1)
    first, second = cell.step(events=[Start()])
    assert [said(plan, each).generation for each in (first, second)] == [0, 1]
    assert cell.missing_count == 0
    (third,) = cell.step()
    assert said(plan, third).generation == 2
    published, report = cell.step(heard(plan, (1,), stop_at=9))
    assert said(plan, published).stop_at == 9
    assert (report.generation, cell.state) == (3, "stopped")


def test_in_async_mode_gaps_in_the_senders_count_are_lost_messages():
    plan = plan_of(mode="async", target=-1.0)
    cell = Cell(plan, 0, job=1)
    cell.step(heard(plan, (1,), sent=1), [Start()])
    cell.step(heard(plan, (1,), sent=5, generation=4))
    assert (cell.inbox.kept, cell.lost) == (2, 3)


def test_in_async_mode_a_silent_neighbour_is_stood_in_for_by_the_cell_itself():
    plan = plan_of(mode="async", target=-1.0, mutation=0.0)
    cell = Cell(plan, 0, job=1)
    before = None
    for _ in range(3):
        cell.step(events=[Start()] if before is None else [])
        before = before if before is not None else cell.rows.genomes.copy()
    np.testing.assert_array_equal(cell.rows.genomes, before)


@pytest.mark.parametrize("emigrants", [1, 3])
def test_emigrants_are_the_best_of_the_deme_best_first(emigrants):
    plan = plan_of(deme=6, emigrants=emigrants)
    cell = Cell(plan, 0, job=1)
    (published,) = cell.step(events=[Start()])
    order = np.argsort(cell.rows.fitness[0], kind="stable")[:emigrants]
    assert said(plan, published).emigrants == tuple(
        Emigrant(cell.rows.genomes[0, index].tobytes(), cell.rows.fitness[0, index]) for index in order
    )


def test_lost_messages_stop_nobody_when_cells_ask(random_source):
    """A bus that loses a third of all messages, and asks for them whenever nothing else can go on."""

    class Lossy(Bus):
        def carry_out(self, cell, action):
            if isinstance(action, Ask):
                question = cell.number, action.generation
                self.events[action.neighbour].append(Asked(action.generation, question))
            elif isinstance(action, Answer):
                asker, generation = action.question
                self.events[asker].append(Answered(cell.number, generation, action.payloads))
            else:
                super().carry_out(cell, action)

        def run(self):
            while len(self.reports) < len(self.cells):
                for cell in self.cells:
                    news, self.news[cell.number] = self.news[cell.number], []
                    events, self.events[cell.number] = self.events[cell.number], []
                    for action in cell.step(news, [*events, Waited()]):
                        self.carry_out(cell, action)
            return [self.reports[number] for number in range(len(self.cells))]

    plan = plan_of(generations=12, target=-1.0)
    lossy = Lossy(plan, random_source, drop=0.33).run()
    sound = Bus(plan, random_source).run()
    assert [report.digest for report in lossy] == [report.digest for report in sound]
    assert sum(report.lost for report in lossy) > 100
