"""Write a commented problem file to start from."""

import argparse
from pathlib import Path

from supernode import exits

EXAMPLE = "supernode init arm-ik my-arm.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the kind and the file."""
    parser.add_argument("kind", metavar="KIND", help="a kind of problem (see `supernode problems`)")
    parser.add_argument("file", metavar="FILE", nargs="?", help="the file to write (KIND.toml)")


def run(options: argparse.Namespace) -> int:
    """Write the file; never overwrite one."""
    from problems import BadInput
    from problems.registry import find_registered

    try:
        template = find_registered(options.kind).template
    except BadInput as error:
        raise BadInput(f"KIND: {error}") from None
    path = Path(options.file or f"{options.kind}.toml")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(template)
    except FileExistsError:
        raise BadInput(f"{path}: expected a new file, found one that exists") from None
    except OSError as error:
        raise BadInput(f"{path}: expected a file that can be written, found {error.strerror}") from None
    print(f"wrote {path}; solve it with: supernode solve {path}")
    return exits.OK
