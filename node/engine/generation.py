"""The generations of one cell, step by step: `node.engine.rule` in kernels, the rest by calls from Python.

This serves a fitness in Python, and every problem where compiled code must not call others by address. The kernels find
the cell's arrays by a table of pointers, since passing an array to a kernel costs as much as breeding with it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import types

from genetics.operators import TABLE, Operator, Table
from genetics.recipe import ONE_BIT
from lowlevel.compiled import kernel
from lowlevel.pointers import integers, octets
from node.engine import cell_table as at
from node.engine import ring
from node.engine.flags import REFUSED, UNSOUND
from node.engine.history import History
from node.engine.inbox import Inbox, hear, packed
from node.engine.kernels import OWN
from node.engine.outbox import Outbox
from node.engine.rows import Rows
from node.engine.rule import (
    add_state,
    finish,
    is_missing_any,
    make_couples,
    publish_message,
    record_and_publish,
    replace,
)
from node.engine.state import read_state
from node.engine.state_size import LEAST_DISTANCE
from node.plan import Plan
from problems import EvaluationFailed
from wire.exchange_layout import EPOCH, GENERATION, JOB, STOP_AT
from wire.report import MOST_BIRTHS, Birth


@kernel(types.void(TABLE))
def _publish_first(table: Table) -> None:
    """Record and publish generation 0."""
    integers(table, at.OUTCOME_ROW)[0, :] = 0
    record_and_publish(table, 0, 0)


@kernel(types.void(TABLE))
def _publish_again(table: Table) -> None:
    """Set the clock by the cell's message, and publish that again."""
    done, header = integers(table, at.OUTCOME_ROW)[0], integers(table, at.HEADER)[OWN]
    done[:] = 0
    integers(table, at.CLOCK)[0, 0] = header[GENERATION]
    done[at.SIZE] = publish_message(table, integers(table, at.SETTINGS_ROW)[0], header[GENERATION])


@kernel(types.int64(TABLE))
def _add_state_to_latest(table: Table) -> int:
    """Write the latest message and the cell's state; return the size, 0 if the message is not of this generation."""
    settings, header = integers(table, at.SETTINGS_ROW)[0], integers(table, at.HEADER)[OWN]
    room, entries, marks = octets(table, at.OUT)[0], integers(table, at.OUT_ENTRIES), integers(table, at.OUT_MARKS)[0]
    is_latest = ring.latest_number(entries, marks) == integers(table, at.CLOCK)[0, 0]
    may_write = header[STOP_AT] == settings[at.LIMIT] and settings[at.STATE_BYTES] > 0
    return add_state(table, ring.latest(room, entries, marks)) if is_latest and may_write else 0


@kernel(types.boolean(TABLE))
def _make_couples(table: Table) -> bool:
    """Begin the next generation, unless a message is missing; return whether it has begun."""
    integers(table, at.OUTCOME_ROW)[0, :] = 0
    ready = not is_missing_any(table)
    if ready:
        make_couples(table, integers(table, at.CLOCK)[0, 0] + 1)
    return ready


@kernel(types.void(TABLE))
def _replace(table: Table) -> None:
    """Let the evaluated offspring of the next generation replace individuals."""
    replace(table, integers(table, at.CLOCK)[0, 0] + 1)


@kernel(types.void(TABLE))
def _finish(table: Table) -> None:
    """Count, record and publish the next generation."""
    finish(table, integers(table, at.CLOCK)[0, 0] + 1)


class Operators(NamedTuple):
    """The operators that compiled generations call by address."""

    variation: Operator | None = None
    mutate_one_bit: Operator | None = None
    fitness: Operator | None = None


class Generations:
    """The generations of one cell.

    It shares its arrays with the given objects by address, so these must not replace them later.

    Args:
        plan: the plan of the cell's epoch.
        rows: the cell's only row; its first generation must have been made (`Rows.begin`).
        inbox: the cell's inbox.
        history: the cell's history.
        champion: whether the cell's messages carry its champion.
        outbox: where the cell's messages are written.

    Attributes:
        is_compiled: whether generations are one compiled call, which other compiled code can make too.
        table: pointers to everything that a generation works on, see `node.engine.cell_table`.
    """

    is_compiled = False

    def __init__(self, plan: Plan, rows: Rows, inbox: Inbox, history: History, champion: bool, outbox: Outbox) -> None:
        operators = self._operators(plan, rows)
        self._plan, self._mutates_one_bit = plan, plan.recipe.mutation == ONE_BIT
        self._alone = plan.run.deme == 1
        couples = plan.slots * plan.run.emigrants if self._alone else plan.recipe.couples(plan.run.deme)
        self._couples = np.zeros((couples, 2, plan.coding.genome_bytes), np.uint8)
        self._offspring = np.zeros((2 * couples, plan.coding.genome_bytes), np.uint8)
        self._offspring_fitness = np.zeros(2 * couples)
        self._outcome = at.OUTCOME.zeros()
        self._births, self._birth_fitness = np.zeros((MOST_BIRTHS, 2), np.int64), np.zeros(MOST_BIRTHS)
        self._birth_count = np.zeros(1, np.int64)
        for number, birth in enumerate(rows.births):  # of generation 0
            self._births[number], self._birth_fitness[number] = birth[:2], birth.fitness
            self._birth_count += 1
        self._rows, self._evaluate = rows, plan.guarded(rows.problems[0])
        self._failure: EvaluationFailed | None = None
        header, genomes, fitness = rows.messages
        self._settings = _settings(plan, rows, champion, operators)
        arrays = {
            "header": header,
            "genomes": genomes,
            "fitness": fitness,
            "source_rows": inbox.source_rows,
            "latest": inbox.latest,
            "counts": inbox.counts,
            "used": inbox.used,
            "staleness": inbox.staleness,
            "inbox": inbox.table,
            "deme": rows.genomes,
            "deme_fitness": rows.fitness,
            "better_at": rows.better_at,
            "clock": rows.clock,
            "noted_fitness": rows.noted,
            "target": np.array([rows.target]),
            "parents": np.zeros((couples, 2), np.int64),
            "couples": self._couples,
            "offspring": self._offspring,
            "offspring_fitness": self._offspring_fitness,
            "variation_table": _table(operators.variation),
            "mutate_table": _table(operators.mutate_one_bit),
            "fitness_table": _table(operators.fitness),
            "record": history.record,
            "digest": history.states,
            "out": outbox.room,
            "out_entries": outbox.entries,
            "out_marks": outbox.marks,
            "out_with_state": outbox.with_state,
            "births": self._births,
            "birth_fitness": self._birth_fitness,
            "birth_count": self._birth_count,
            "settings_row": self._settings,
            "outcome_row": self._outcome,
        }
        # The table holds bare addresses, so everything that they point to must live as long as this object.
        self._kept = operators
        self._inbox = inbox
        self._arrays = arrays
        self.table = at.TABLE.build(**arrays)
        self._inbox_table = inbox.table
        self._done = self._outcome.data

    def _operators(self, plan: Plan, rows: Rows) -> Operators:
        """Return none: steps from Python call the coding and the problem, which need not have compiled operators."""
        return Operators()

    def publish_first(self) -> None:
        """Record and publish generation 0, which `Rows.begin` has made; then ask `done`."""
        _publish_first(self.table)

    def go_on_from(self, state: bytes) -> None:
        """Go on from a `node.engine.state`, whose message is published again; then ask `done`.

        Raises:
            EvaluationFailed: if it is no state of this cell in this problem.
        """
        header, rows = self._arrays["header"][OWN], self._rows
        expected = header.item(JOB), header.item(EPOCH), rows.limit
        try:
            read_state(state, self._arrays)
        except ValueError as error:
            raise EvaluationFailed(str(error)) from None
        if (header.item(JOB), header.item(EPOCH), header.item(STOP_AT)) != expected or not rows.is_sound():
            raise EvaluationFailed("the state that a neighbour has kept does not fit the problem")
        self.send_state()
        _publish_again(self.table)

    def add_state_to_latest(self) -> int:
        """Write the latest message with the cell's state to the outbox, beside those that it keeps.

        Returns:
            The size of both in bytes; 0 if the cell has no state that fits the message.
        """
        return _add_state_to_latest(self.table)

    def keep_states_every(self, messages: int) -> None:
        """Let every so many-th message carry the state; a power of two, so that cells agree as far as they can."""
        self._settings[at.STATE_EVERY] = messages

    def tell_stop(self, stop_at: int | None) -> None:
        """Stop after a generation, if there is one; perhaps no neighbour tells it in time."""
        if stop_at is not None:
            self._settings[at.TOLD_STOP] = stop_at
            self._inbox.note_stop(stop_at)

    def send_state(self) -> None:
        """Let the next message carry the cell's state."""
        self._settings[at.STATE_NEXT] = 1

    def __call__(self, news: Sequence[tuple[int, bytes]], most: int) -> None:
        """Take in ``news`` and breed one generation, if no message is missing; then ask `done`."""
        refused = bool(news) and hear(packed(news), self._inbox_table) > 0
        if _make_couples(self.table):
            try:
                self._breed()
            except EvaluationFailed as error:
                self._failure = error
                self._outcome[at.FLAGS] = UNSOUND
        if refused:
            self._outcome[at.FLAGS] |= REFUSED

    def _breed(self) -> None:
        """Breed the next generation, whose couples are made. The order of the steps is that of the compiled `_breed`.

        ``evaluate`` is a user's code: it gets arrays that nothing else writes to, and may keep them. What it changes in
        offspring counts, as it does in the simulator.
        """
        offspring, coding, rows = self._offspring, self._plan.coding, self._rows
        keys = self._plan.keys(rows.cells, rows.generation + 1)
        offspring[:] = coding.recombine(self._couples[None], self._plan.recipe, keys)[0]
        if self._mutates_one_bit and self._alone:
            coding.mutate_one(offspring[None], keys)
        given = offspring.copy()
        self._offspring_fitness[:] = self._evaluate(given)
        offspring[:] = given
        _replace(self.table)
        if self._mutates_one_bit and not self._alone:
            deme, deme_fitness = rows.genomes[0], rows.fitness[0]
            changed = coding.mutate_one(rows.genomes, keys)[0]
            deme_fitness[changed] = self._evaluate(deme[changed : changed + 1].copy())[0]
        _finish(self.table)

    def done(self) -> list[int]:
        """Return what the latest call has done, also one of `breed_on` by other compiled code.

        Returns:
            The columns of `node.engine.cell_table.OUTCOME`.
        """
        done: list[int] = self._done.tolist()
        return done

    def failure(self) -> EvaluationFailed:
        """Return why the latest generation could not be bred, after `UNSOUND`."""
        assert self._failure is not None, "nothing has failed"
        return self._failure

    def births(self) -> list[Birth]:
        """Return the improvements that the cell has noted."""
        noted = slice(self._birth_count.item())
        births, fitness = self._births[noted].tolist(), self._birth_fitness[noted].tolist()
        return [Birth(born, cell, its) for (born, cell), its in zip(births, fitness, strict=True)]


def _table(operator: Operator | None) -> Table:
    return np.zeros((1, 3), np.int64) if operator is None else operator.table


def _settings(plan: Plan, rows: Rows, champion: bool, operators: Operators) -> Any:
    run, recipe = plan.run, plan.recipe
    return at.SETTINGS.build(
        variation=_address(operators.variation),
        mutate_one_bit=_address(operators.mutate_one_bit),
        fitness_kernel=_address(operators.fitness),
        emigrants=run.emigrants,
        elitist=recipe.replacement == "elitist",
        seed=plan.seed.astype(np.int64),  # the same 64 bits, which the kernel reads as unsigned again
        cell=rows.cells[0],
        first_evaluations=run.deme,
        evaluations=plan.evaluations_per_generation,
        interval=run.interval,
        lockstep=run.mode == "lockstep",
        champion=champion,
        target_reporter=rows.target_reporter,
        stall=-1 if rows.stall is None else rows.stall,
        stop_distance=plan.stop_distance,
        told_stop=rows.limit,
        limit=rows.limit,
        families=recipe.renewal is None,
        better_half=recipe.pairing == "better-half",
        most_selections=recipe.most_selections,
        most_bytes=plan.limits.most_bytes_without_state,
        state_bytes=plan.limits.most_state_bytes,
        state_every=LEAST_DISTANCE,
        state_next=0,
    )


def _address(operator: Operator | None) -> int:
    return 0 if operator is None else operator.address
