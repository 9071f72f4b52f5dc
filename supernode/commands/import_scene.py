"""Write a problem file for a scene from elsewhere.

Reads MoveIt's .scene texts, its planning scenes and motion-plan requests as YAML or JSON (as robowflex and
MotionBenchMaker write them, too), and MotionBenchMaker's problems as JSON. Several files, such as a scene and a
request, become one problem. Joint values are rad or m, as in these files.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from supernode import exits

if TYPE_CHECKING:
    from supernode.scenes.problem_fields import Imported

EXAMPLE = "supernode import kitchen.scene --robot panda --group arm --start default -o kitchen.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the files, the robot, and what the files may not say."""
    parser.add_argument("files", metavar="FILE", nargs="+", help="a .scene, .yaml, .yml or .json file")
    parser.add_argument("-o", "--output", metavar="FILE", help="the problem file to write (standard output)")
    parser.add_argument("--kind", choices=("robot-path", "robot-ik"), default="robot-path", help="%(default)s")
    parser.add_argument("--problem", metavar="N", type=int, help="which problem of a file that has many (the first)")
    robot = parser.add_argument_group("robot (by default the one of example-robot-data that the scene names)")
    robot.add_argument("--robot", metavar="URDF", help="a URDF file, or a robot of `supernode robots`")
    robot.add_argument("--srdf", metavar="SRDF", help="its SRDF")
    robot.add_argument("--group", metavar="GROUP", help="the group of the SRDF that moves (the request's)")
    robot.add_argument(
        "--packages", metavar="FOLDER", action="append", help="where package:// looks; may be given several times"
    )
    ends = parser.add_argument_group("start and goal (by default the scene's or request's)")
    for name in ("start", "goal"):
        ends.add_argument(
            f"--{name}", metavar="VALUES", help=f"numbers, as in --{name}=-0.5,1,0; or a state of the SRDF"
        )


def run(options: argparse.Namespace) -> int:
    """Read all files, write the problem file and meshes beside it, and say on stderr what is missing."""
    from supernode.scenes.problem_fields import Wishes, fields_of
    from supernode.scenes.reading import read_files
    from supernode.scenes.robot import Choice, RobotOfScene

    scene = read_files(options.files, options.problem)
    robot = RobotOfScene.of(Choice(options.robot, options.srdf, options.group, options.packages), scene)
    output = None if options.output is None else Path(options.output)
    folder = Path() if output is None else output.parent
    meshes = None if output is None else folder / f"{output.stem}-meshes"
    imported = fields_of(scene, robot, Wishes(options.kind, options.start, options.goal, folder, meshes))
    _write(imported, options.files, output)
    for note in imported.notes:
        print(f"note: {note}", file=sys.stderr)
    if output is not None:
        solids = len(imported.fields.get("obstacles", [])) + len(imported.fields.get("attached", []))
        print(f"wrote {output}: {solids} solids; solve it with: supernode solve {output}")
    return exits.OK


def _write(imported: "Imported", files: list[str], output: Path | None) -> None:
    from supernode.files.outputs import unwritable, write_output
    from supernode.files.toml_text import as_tables

    text = f"# imported from {', '.join(Path(each).name for each in files)}\n{as_tables(imported.fields)}"
    if output is None:
        print(text, end="")
        return
    for path, mesh in imported.meshes.items():
        try:
            path.parent.mkdir(exist_ok=True)
        except OSError as error:
            raise unwritable(str(path.parent), error) from None
        write_output(mesh.encode(), str(path))
    write_output(text.encode(), str(output))
