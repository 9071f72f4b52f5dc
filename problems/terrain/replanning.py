"""Adapt a living population to a changed map: lead the old paths on from where the robot stands now (Fries, §3.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from genetics.arrays import Genomes, writable

if TYPE_CHECKING:
    from problems.terrain.model import TerrainModel


def led_on(old: TerrainModel, new: TerrainModel, genomes: Genomes) -> Genomes:
    """Return genomes of ``old``, (.., genome_bytes), adapted to ``new``: the same map with another start or cells.

    Each path goes straight from the new start to its own nearest cell, and on from there. Where new obstacles lie on
    it, it is mended once as in the tuned recipe: by cells along what blocks it, and in a small window there.

    Raises:
        ValueError: If the new map has another size, or its genomes another length.
    """
    from problems.terrain import kernels

    if old.impassable.shape != new.impassable.shape or old.coding.genome_bytes != new.coding.genome_bytes:
        raise ValueError(f"expected a map of the same size, {old.impassable.shape}, found {new.impassable.shape}")
    flat = writable(genomes.reshape(-1, genomes.shape[-1]))
    led: Genomes = kernels.led_on(flat, old.fitness_kernel.table, new.fitness_kernel.table, new.coding.reach)
    return led.reshape(genomes.shape)
