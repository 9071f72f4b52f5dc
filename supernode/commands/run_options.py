"""Options that `solve`, `simulate` and `submit` share: how a problem is run, and what the command reports."""

import argparse
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spy.least_improvement import LEAST

if TYPE_CHECKING:
    from problems import ProblemFile

_SETTINGS = (
    "topology",
    "deme",
    "interval",
    "emigrants",
    "mode",
    "replacement",
    "mutation",
    "spy",
    "seed",
    "recipe",
    "generations",
    "evaluations",
    "seconds",
    "target",
    "stall",
    "restarts",
    "oracle",
)


def add_run_options(parser: argparse.ArgumentParser) -> None:
    """Add the problem, the settings of a run, and what the command reports."""
    add_settings(parser)
    add_report(parser)


def add_report(parser: argparse.ArgumentParser) -> None:
    """Add what the command reports."""
    out = parser.add_argument_group("what to report")
    out.add_argument("--log", metavar="FILE", help="write a run log as JSON Lines")
    add_least_improvement(out)
    out.add_argument("--plot", metavar="FILE", help="draw the result (PNG, SVG or PDF, by the name's end)")
    out.add_argument(
        "--retime", action="store_true", help="robot-path: add the quickest motion along the path that keeps all limits"
    )
    out.add_argument("--json", action="store_true", help="print the result as one JSON object")
    out.add_argument("--quiet", action="store_true", help="no progress on stderr")


def add_least_improvement(out: argparse._ArgumentGroup | argparse.ArgumentParser) -> None:
    """Add the threshold below which improvements are not reported."""
    out.add_argument(
        "--least-improvement",
        metavar="R",
        type=share,
        default=LEAST,
        help="the least improvement to report, as a share of the fitness before (%(default)s; 0: all)",
    )


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Add the settings of a run, each of which wins over the ``[run]`` table of the problem file."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    run = parser.add_argument_group("how to run (each wins over the file's [run] table)")
    shape = run.add_mutually_exclusive_group()
    shape.add_argument("--torus", metavar="RxC", type=torus, dest="topology", help="rows and columns (4x4)")
    shape.add_argument("--topology", metavar="SPEC", help='such as "torus 4x4" or "ring 16"')
    run.add_argument("--deme", metavar="N", type=whole, help="individuals on each node (1)")
    add_breeding_options(run)
    run.add_argument("--mode", choices=("lockstep", "async"), help="wait for neighbours, or do not wait (lockstep)")
    run.add_argument("--seed", metavar="N", type=whole, help="the same seed gives the same run (1)")
    end = parser.add_argument_group("when to stop (by default at the target, or after --stall 200)")
    end.add_argument("--generations", metavar="N", type=whole, help="after this generation")
    end.add_argument("--evaluations", metavar="N", type=whole, help="before more fitness calls than this")
    end.add_argument("--seconds", metavar="S", type=number, help="at this deadline")
    end.add_argument("--target", metavar="F", type=number, help="at this fitness, instead of the problem's own")
    end.add_argument("--stall", metavar="N", type=whole, help="after N generations without a better champion")
    end.add_argument("--restarts", metavar="N", type=whole, help="restart up to N times instead, when it stalls (8)")
    end.add_argument(
        "--no-oracle",
        dest="oracle",
        action="store_false",
        default=None,  # not True: only settings that are given win over the file
        help="do not ask an exact method, beside the run, whether there is a solution",
    )


def add_breeding_options(run: argparse._ArgumentGroup) -> None:
    """Add the settings of exchange and breeding, which `scale` has too."""
    run.add_argument("--interval", metavar="N", type=whole, help="generations between exchanges (1)")
    run.add_argument("--emigrants", metavar="N", type=whole, help="individuals sent in an exchange (1)")
    run.add_argument("--recipe", choices=("tuned", "paper"), help="the best known operators, or the paper's (tuned)")
    run.add_argument("--replacement", choices=("offspring", "elitist"), help="which individual survives (the recipe's)")
    run.add_argument("--mutation", metavar="P", type=_mutation, help='probability that a bit changes, or "one-bit"')
    run.add_argument("--spy", choices=("champion", "root"), help="what the root learns of (champion)")


def chosen_file(options: argparse.Namespace) -> "ProblemFile":
    """Return the problem file with the settings of the command line; check all that can be checked before a launch.

    Raises:
        BadInput: if anything is wrong.
    """
    from problems import load

    check_outputs(options)
    file = load(options.problem).with_run(**settings(options))
    file.refuse_unreachable()
    return file


def check_outputs(options: argparse.Namespace) -> None:
    """Check that the log and the picture can be written.

    Raises:
        BadInput: if the name of one of them is wrong.
    """
    from supernode.pictures.picture import check_picture_name

    if options.plot is not None:
        check_picture_name(options.plot)
    _check_folder("--log", options.log)
    _check_folder("--plot", options.plot)


def settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return the settings that were given."""
    return {name: getattr(options, name) for name in _SETTINGS if getattr(options, name) is not None}


def _check_folder(option: str, name: str | None) -> None:
    from problems import BadInput

    if name is not None and not Path(name).absolute().parent.is_dir():
        raise BadInput(f"{option}: expected a file in a folder that exists, found {name}")


def torus(text: str) -> str:
    """Parse the value of an option: a torus such as "4x4"."""
    import topologies

    try:
        return topologies.torus_spec(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def whole(text: str) -> int:
    """Parse the value of an option: a whole number."""
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a whole number, found {text!r}") from None


def positive(text: str) -> float:
    """Parse the value of an option: a finite number greater than 0."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number greater than 0, found {text}")
    return value


def size(text: str) -> int:
    """Parse the value of an option: bytes, such as 500M or 2G; 1M at least: fewer are meant in another unit."""
    units = {"k": 10, "m": 20, "g": 30, "t": 40}
    found = re.fullmatch(r"(\d+(?:\.\d+)?)([kmgt]?)b?", text.strip().lower())
    bytes_ = 0 if found is None else int(float(found[1]) * (1 << units.get(found[2], 0)))
    if bytes_ < 1 << 20:
        raise argparse.ArgumentTypeError(f"expected a size such as 500M or 2G, 1M at least, found {text}")
    return bytes_


def number(text: str) -> float:
    """Parse the value of an option: a number."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected a number, found {text!r}") from None


def share(text: str) -> float:
    """Parse the value of an option: a share, at least 0 and below 1."""
    value = number(text)
    if not 0.0 <= value < 1.0:
        raise argparse.ArgumentTypeError(f"expected a share from 0 to below 1, found {text!r}")
    return value


def _mutation(text: str) -> float | str:
    if text == "one-bit":
        return text
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected a probability or "one-bit", found {text!r}') from None
