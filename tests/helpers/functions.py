"""Plans of functions with a compiled fitness, of each coding."""

from node.plan import Plan
from problems import Run
from problems.function import Function

PROBLEMS = {
    "onemax": {"name": "onemax", "dimension": 30},
    "trap": {"name": "trap", "dimension": 20},
    "graph-partition": {"name": "graph-partition", "graph": {"vertices": 20, "parts": 3, "seed": 5}},
    "rastrigin of reals": {"name": "rastrigin", "dimension": 3},
    "rastrigin of bits": {"name": "rastrigin", "dimension": 3, "bits": 9},
}
DEMES = [{}, {"deme": 6, "emigrants": 2}, {"deme": 2}, {}, {"deme": 9, "replacement": "offspring"}]


def plan_of(name, problem=Function, **run):
    settings = Run(**run)
    fields = {"kind": "function"} | PROBLEMS[name]
    return Plan(problem.model_validate(fields).for_recipe(settings.recipe, settings.deme), settings)
