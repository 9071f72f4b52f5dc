"""A function that costs as much processor time as asked for, for compiled generations."""

from genetics.arrays import Fitness, Genomes
from genetics.calls_by_address import call_fitness
from genetics.operators import FITNESS, Table
from lowlevel.compiled import kernel
from lowlevel.pointers import integers
from problems.function.kernels import spend


@kernel(FITNESS, may_be_long=True)
def costly(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Another function, after the processor time asked for.

    Its table: the other function's address, and nanoseconds for each genome; then the other function's table.
    """
    spend(integers(table, 0)[0, 1] * fitness.size)
    call_fitness(integers(table, 0)[0, 0], genomes, fitness, integers(table, 1))
