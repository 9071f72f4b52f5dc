"""A problem whose first attempts surely stall, each with longer individuals than the one before."""

import json
from pathlib import Path

MODULE = """
import json

import numpy as np

import supernode


class Stubborn(supernode.Problem):
    '''As many bits as possible are to be 1; while there are ``hurdles``, it counts as if so many never were.'''

    size: int = 16
    hurdles: int = 2
    grows: int = 8
    gives_up: int | None = None
    answers: str = ""

    @property
    def coding(self):
        return supernode.BitString(self.size, 1)

    @property
    def solved_at(self):
        return 0.0

    def evaluate(self, genomes):
        missing = self.size - np.unpackbits(genomes, axis=1)[:, : self.size].sum(axis=1).astype(float)
        return missing + self.hurdles

    def decode(self, genome):
        return {"missing": float(self.evaluate(genome[None])[0])}

    def check(self, solution):
        missing = solution["missing"]
        return supernode.Verdict(missing, () if missing == 0 else ("it is not full",))

    def draw(self, figure, solution, populations):
        for genomes in populations.values():
            assert genomes.shape[1] == self.coding.genome_bytes, "they are coded as the latest attempt's are"
        figure.subplots().plot([0, solution["missing"]])

    def next_attempt(self, attempt):
        if self.answers:
            return json.loads(self.answers)
        if self.gives_up is not None and attempt >= self.gives_up:
            return None
        return {"size": self.size + self.grows, "hurdles": max(0, self.hurdles - 1)}
"""


def stubborn_file(folder, *lines, **fields):
    """The path of a problem file in that folder, which has more ``lines`` at its end; its module is beside it."""
    (Path(folder) / "stubborn_module.py").write_text(MODULE)
    path = Path(folder) / "stubborn.toml"
    given = [f"{name} = {json.dumps(value)}" for name, value in fields.items()]
    path.write_text("\n".join(['kind = "stubborn_module:Stubborn"', *given, *lines]) + "\n")
    return path
