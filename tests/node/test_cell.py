"""Events in, the exact actions out; no cluster, no clock."""

import dataclasses

import numpy as np
import pytest
from one_max import Bus, OneMax, plan_of

from node import Cell, Plan
from node.cell import Answer, Ask, Asked, Heard, Propose, Publish, Start, Waited
from problems import Run
from wire.exchange import Champion, Emigrant
from wire.report import Report


def message_of(plan, cell, **changes):
    """What ``cell`` says in generation 0."""
    published, *_ = Cell(plan, cell, job=1).step([Start()])
    return dataclasses.replace(published.message, **changes)


def heard(plan, senders, **changes):
    return [Heard(sender, message_of(plan, sender, **changes)) for sender in senders]


def test_before_start_it_only_listens():
    plan = plan_of()
    cell = Cell(plan, 5, job=1)
    assert cell.neighbours == (1, 6, 9, 4)
    assert cell.step(heard(plan, cell.neighbours)) == []
    assert cell.state == "prepared"
    first, second = cell.step([Start()])
    assert (first.message.generation, second.message.generation) == (0, 1)


def test_start_publishes_the_first_generation_and_waits():
    plan = plan_of()
    cell = Cell(plan, 0, job=1)
    (published,) = cell.step([Start()])
    message = published.message
    assert (message.job, message.world, message.generation, message.stop_at) == (1, 0, 0, None)
    assert (message.sent, message.evaluations) == (1, 1)
    (emigrant,) = message.emigrants
    assert message.champion == Champion(emigrant.fitness, 0, 0, emigrant.genome)
    assert not cell.ready
    assert cell.step([]) == []


def test_a_generation_needs_every_neighbour_whatever_the_order():
    plan = plan_of()
    news = heard(plan, (12, 1, 4, 3))
    outcomes = []
    for order in ([0, 1, 2, 3], [3, 1, 0, 2]):
        cell = Cell(plan, 0, job=1)
        cell.step([Start()])
        for index in order[:-1]:
            assert cell.step([news[index]]) == []
        outcomes.append(cell.step([news[order[-1]]]))
    assert outcomes[0] == outcomes[1]
    (published,) = outcomes[0]
    assert published.message.generation == 1
    assert published.message.evaluations == 1 + 8


def test_messages_of_another_job_strangers_and_doubles_are_ignored():
    plan = plan_of()
    cell = Cell(plan, 0, job=1)
    cell.step([Start()])
    other_job = heard(plan, (1,), job=2)
    stranger = [Heard(10, message_of(plan, 10))]
    far_future = heard(plan, (1,), generation=99)
    assert cell.step(other_job + stranger + far_future) == []
    assert cell.received == 0
    once = heard(plan, (1,))
    cell.step(once + once)
    assert cell.received == 1


def test_it_asks_for_what_is_missing_and_counts_it_as_lost_when_it_comes():
    plan = plan_of()
    cell = Cell(plan, 0, job=1)
    assert cell.step([Waited()]) == [], "nothing is missing before the start"
    cell.step([Start(), *heard(plan, (12, 4))])
    assert cell.step([Waited()]) == [Ask(1, 0), Ask(3, 0)]
    cell.step(heard(plan, (1, 3)))
    assert cell.rows.generation == 1
    assert cell.lost == 2


def test_it_answers_for_its_last_two_generations():
    plan = plan_of()
    cell = Cell(plan, 0, job=1)
    (first,) = cell.step([Start()])
    (second,) = cell.step(heard(plan, (12, 1, 4, 3)))
    assert cell.step([Asked(0, "q"), Asked(1, "r"), Asked(7, "s")]) == [
        Answer("q", first.message),
        Answer("r", second.message),
    ]


def test_the_cell_that_bred_the_target_proposes_to_stop():
    plan = plan_of(size=1, mutation=0.0, seed=3)
    cell = next(cell for cell in (Cell(plan, number, 1) for number in range(16)) if _starts_solved(cell))
    assert cell.rows.stop_at[0] == plan.stop_distance == 5
    (proposal,) = cell.rows.proposals
    assert (proposal.reason, proposal.cell, proposal.generation) == ("target", cell.cell, 0)


def _starts_solved(cell):
    cell.step([Start()])
    return cell.rows.fitness[0, 0] == 0.0


def test_the_least_stop_wins_and_is_passed_on():
    plan = plan_of(size=40, target=-1.0)
    cell = Cell(plan, 0, job=1)
    cell.step([Start()])
    news = heard(plan, (12, 1, 4)) + heard(plan, (3,), stop_at=4)
    (published,) = cell.step(news)
    assert published.message.stop_at == 4
    cell.step([Propose("cancel")])
    assert cell.rows.stop_at[0] == 4, "a later stop changes nothing"


def test_it_stops_at_the_limit_with_a_report_and_no_further_message():
    plan = plan_of(generations=1, target=-1.0)
    cell = Cell(plan, 0, job=1)
    cell.step([Start()])
    (report,) = cell.step(heard(plan, (12, 1, 4, 3)))
    assert isinstance(report, Report)
    assert (report.generation, report.evaluations, report.sent, report.received) == (1, 9, 1, 4)
    assert report.deme == cell.rows.genomes.tobytes()
    assert cell.state == "stopped"
    assert cell.step([Start(), Propose("cancel"), Waited()]) == []


def test_a_problem_that_breaks_fails_the_cell_with_its_message():
    class Broken(OneMax):
        def evaluate(self, genomes):
            raise RuntimeError("out of paper")

    cell = Cell(Plan(Broken(kind="broken"), Run()), 0, job=1)
    (report,) = cell.step([Start()])
    assert report.error == "broken: evaluate raised RuntimeError: out of paper"
    assert cell.state == "failed"


def test_under_the_papers_spy_champions_do_not_travel_but_to_the_spy():
    plan = plan_of(spy="root")
    assert message_of(plan, 5).champion is None
    assert message_of(plan, 0).champion is not None
    cell = Cell(plan, 1, job=1)
    cell.step([Start()])
    lie = Champion(-5.0, 0, 0, bytes(5))
    news = [Heard(other, message_of(plan, other, champion=lie)) for other in cell.neighbours]
    cell.step(news)
    assert cell.rows.champion_fitness[0] >= 0.0, "only emigrants are heard of"


def test_in_async_mode_every_step_breeds_and_a_stop_is_passed_on_at_once():
    plan = plan_of(mode="async", target=-1.0)
    cell = Cell(plan, 0, job=1)
    first, second = cell.step([Start()])
    assert (first.message.generation, second.message.generation) == (0, 1)
    assert cell.ready
    (third,) = cell.step([])
    assert third.message.generation == 2
    published, report = cell.step(heard(plan, (1,), stop_at=9))
    assert isinstance(published, Publish)
    assert published.message.stop_at == 9
    assert (report.generation, cell.state) == (3, "stopped")


def test_in_async_mode_gaps_in_the_senders_count_are_lost_messages():
    plan = plan_of(mode="async", target=-1.0)
    cell = Cell(plan, 0, job=1)
    cell.step([Start(), *heard(plan, (1,), sent=1)])
    cell.step(heard(plan, (1,), sent=5, generation=4))
    assert (cell.received, cell.lost) == (2, 3)


def test_in_async_mode_a_silent_neighbour_is_stood_in_for_by_the_cell_itself():
    plan = plan_of(mode="async", target=-1.0, mutation=0.0)
    cell = Cell(plan, 0, job=1)
    before = None
    for _ in range(3):
        cell.step([Start()] if before is None else [])
        before = before if before is not None else cell.rows.genomes.copy()
    np.testing.assert_array_equal(cell.rows.genomes, before)


@pytest.mark.parametrize("emigrants", [1, 3])
def test_emigrants_are_the_best_of_the_deme_best_first(emigrants):
    plan = plan_of(deme=6, emigrants=emigrants)
    cell = Cell(plan, 0, job=1)
    (published,) = cell.step([Start()])
    order = np.argsort(cell.rows.fitness[0], kind="stable")[:emigrants]
    assert published.message.emigrants == tuple(
        Emigrant(cell.rows.genomes[0, index].tobytes(), cell.rows.fitness[0, index]) for index in order
    )


def test_lost_messages_stop_nobody_when_cells_ask(random_source):
    """A bus that loses a third of all messages, and asks for them whenever nothing else can go on."""

    class Lossy(Bus):
        def carry_out(self, cell, action):
            if isinstance(action, Ask):
                self.mail[action.neighbour].append(Asked(action.generation, cell.cell))
            elif isinstance(action, Answer):
                self.mail[action.question].append(Heard(cell.cell, action.message))
            else:
                super().carry_out(cell, action)

        def run(self):
            while len(self.reports) < len(self.cells):
                for cell in self.cells:
                    events, self.mail[cell.cell] = self.mail[cell.cell], []
                    for action in cell.step([*events, Waited()]):
                        self.carry_out(cell, action)
            return [self.reports[number] for number in range(len(self.cells))]

    plan = plan_of(generations=12, target=-1.0)
    lossy = Lossy(plan, random_source, drop=0.33).run()
    sound = Bus(plan, random_source).run()
    assert [report.digest for report in lossy] == [report.digest for report in sound]
    assert sum(report.lost for report in lossy) > 100
