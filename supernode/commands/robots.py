"""List the robots that can be had offline; show one, check its description, write its SRDF, or draw its spheres."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from supernode import exits

if TYPE_CHECKING:
    from problems.robots.fields import Robot
    from problems.robots.urdf import Geometry, Joint

EXAMPLE = "supernode robots panda"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the robot, its files, and what to do with it."""
    parser.add_argument(
        "robot",
        metavar="ROBOT",
        nargs="?",
        help="a URDF file, or a robot of example-robot-data; without it: list these",
    )
    parser.add_argument("--check", action="store_true", help="say what is wrong and how to mend it; exit code 1 if so")
    parser.add_argument("--srdf", metavar="OUT", help="write an SRDF with the pairs of links that need no check")
    parser.add_argument("--spheres", metavar="OUT", help="draw the bounding spheres beside the meshes: PNG, SVG or PDF")
    parser.add_argument("--semantics", metavar="SRDF", help="the robot's SRDF")
    parser.add_argument(
        "--packages", metavar="FOLDER", action="append", help="where package:// looks; may be given several times"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(options: argparse.Namespace) -> int:
    """List, show, check, write or draw."""
    from problems import BadInput

    if options.robot is None:
        if options.check or options.srdf or options.spheres:
            raise BadInput("ROBOT: expected a URDF file or a robot of example-robot-data, found none")
        return _list(options)
    if options.check:
        if options.srdf or options.spheres:
            raise BadInput(f"--check: expected no --{'srdf' if options.srdf else 'spheres'} beside it, found both")
        return _check(options)
    if options.srdf is not None and Path(options.srdf).resolve() in _inputs(options):
        raise BadInput(
            f"--srdf: expected a file to write, found {options.srdf}, which is read; --semantics reads an SRDF"
        )
    robot = _robot(options)
    if options.srdf is None and options.spheres is None:
        facts = _facts(robot)
        print(json.dumps(facts) if options.json else "\n".join(_words(facts)))
    if options.srdf is not None:
        _write_srdf(robot, options.srdf)
    if options.spheres is not None:
        _draw(robot, options.spheres)
    return exits.OK


def _inputs(options: argparse.Namespace) -> set[Path]:
    """Return the files that the command reads."""
    return {Path(each).resolve() for each in (options.robot, options.semantics) if each is not None}


def _list(options: argparse.Namespace) -> int:
    from problems import BadInput
    from problems.robots.loading import home_of_extra, robots_of_extra

    home = home_of_extra()
    if home is None:
        raise BadInput("example-robot-data: expected this package, found none; pip install 'supernode[robots]'")
    robots = {name: str(path.relative_to(home)) for name, path in robots_of_extra().items()}
    if options.json:
        print(json.dumps(robots))
        return exits.OK
    width = max(map(len, robots))
    for name, path in sorted(robots.items()):
        print(f"{name:{width}}  {path}")
    print('\nuse one in a problem file: urdf = "example-robot-data:NAME"; see it: supernode robots NAME')
    return exits.OK


def _name(text: str) -> str:
    """Return the robot as a problem file names it: a file, or one of example-robot-data."""
    from problems.robots.loading import EXTRA, robots_of_extra

    is_known = not Path(text).is_file() and text in robots_of_extra()
    looks_like_a_file = "/" in text or text.endswith((".urdf", ".xml")) or text.startswith(f"{EXTRA}:")
    return f"{EXTRA}:{text}" if is_known or not (looks_like_a_file or Path(text).exists()) else text


def _robot(options: argparse.Namespace) -> "Robot":
    from pydantic import ValidationError

    from problems.errors import first_line
    from problems.robots.fields import Robot
    from problems.robots.loading import gather_description

    fields: dict[str, Any] = {"urdf": _name(options.robot), "packages": options.packages}
    if options.semantics is not None:
        fields["srdf"] = options.semantics
    fields = gather_description({name: value for name, value in fields.items() if value is not None}, Path())
    try:
        return Robot.model_validate(fields)
    except ValidationError as error:
        raise first_line(error, Robot, "ROBOT") from None


def _check(options: argparse.Namespace) -> int:
    from problems.robots.checking import findings
    from problems.robots.loading import path_of

    path = path_of(_name(options.robot), Path(), "ROBOT")
    packages = None if options.packages is None else [Path(each).resolve() for each in options.packages]
    found = findings(path, packages, None if options.semantics is None else Path(options.semantics))
    wrong = sum(each.is_wrong for each in found)
    if options.json:
        print(json.dumps([{"wrong": each.is_wrong, "text": each.text} for each in found]))
    else:
        for each in found:
            print(f"{'wrong' if each.is_wrong else 'note'}: {each.text}")
        print(f"{path}: " + (f"{wrong} to mend" if wrong else "nothing is wrong"))
    return exits.FAILED if wrong else exits.OK


# One robot ------------------------------------------------------------------------------------------------------------
def _facts(robot: "Robot") -> dict[str, Any]:
    from problems import BadInput
    from problems.robots.srdf import read_srdf
    from problems.robots.urdf import read_urdf

    urdf, srdf = read_urdf(robot.urdf), read_srdf(robot.srdf)
    groups: dict[str, list[str]] = {}
    for group in srdf.groups:
        try:
            groups[group] = srdf.joints_of(group, urdf)
        except BadInput:  # a group of links that do not move, or whose joints the URDF does not have
            groups[group] = []
    return {
        "robot": urdf.name,
        "root": urdf.root,
        "joints": [_joint_facts(joint) for joint in urdf.joints.values() if joint.kind != "fixed"],
        "fixed_joints": sum(joint.kind == "fixed" for joint in urdf.joints.values()),
        "links": {link.name: [_geometry_text(robot, each) for each in link.collisions] for link in urdf.links.values()},
        "groups": groups,
        "disabled_pairs": len(srdf.disabled),
    }


def _joint_facts(joint: "Joint") -> dict[str, Any]:
    import math

    return {
        "name": joint.name,
        "type": joint.kind,
        "limits": None if joint.limits is None or joint.kind == "continuous" else list(joint.limits),
        "velocity": None if math.isnan(joint.velocity) else joint.velocity,
        "effort": None if math.isnan(joint.effort) else joint.effort,
        "parent": joint.parent,
        "child": joint.child,
        "mimic": None if joint.mimic is None else joint.mimic[0],
    }


def _geometry_text(robot: "Robot", geometry: "Geometry") -> str:
    from problems.robots.checking import triangles_of

    if geometry.shape == "mesh":
        count = triangles_of(robot, geometry.mesh, geometry.scale)
        return f"mesh {geometry.mesh.rsplit('/', 1)[-1]}, {count:,} triangles"
    return f"{geometry.shape} {' × '.join(f'{each:g}' for each in geometry.size)} m"


def _words(facts: dict[str, Any]) -> list[str]:
    from supernode.terminal.table import table

    rows = []
    for joint in facts["joints"]:
        low, high = joint["limits"] or (None, None)
        kind = joint["type"] if joint["mimic"] is None else f"follows {joint['mimic']}"
        rows.append([joint["name"], kind, low, high, joint["velocity"], joint["effort"], joint["child"]])
    titles = ["joint", "type", "lower", "upper", "velocity", "effort", "carries"]
    links = [[name, "; ".join(shapes) or None] for name, shapes in facts["links"].items()]
    lines = [
        f"{facts['robot']}: {len(facts['joints'])} joints that move, {facts['fixed_joints']} fixed, "
        f"{len(facts['links'])} links from {facts['root']}; rad or m, s, N m or N",
        "",
        table(titles, rows),
        "",
        table(["link", "collision geometry"], links),
    ]
    if facts["groups"]:
        groups = [[name, ", ".join(joints) or None] for name, joints in facts["groups"].items()]
        lines += ["", table(["group", "joints"], groups)]
    pairs = facts["disabled_pairs"]
    return [
        *lines,
        "",
        f"the SRDF disables {pairs} pairs" if pairs else "no pairs in an SRDF: they are found by sampling",
    ]


def _write_srdf(robot: "Robot", name: str) -> None:
    from problems.robots.making import make_srdf
    from problems.robots.srdf import read_srdf
    from supernode.files.outputs import write_output

    text = make_srdf(robot)
    write_output(text.encode(), name)
    origin = "; the SRDF names them, so none were added" if text == robot.srdf else ""
    print(f"wrote {name}: {len(read_srdf(text).disabled)} pairs of links that need no check{origin}")


def _draw(robot: "Robot", name: str) -> None:
    from matplotlib.figure import Figure

    from problems.robots.making import make_arm
    from problems.robots.spheres_drawing import draw_spheres
    from supernode.pictures.picture import check_picture_name, save

    check_picture_name(name, "--spheres")
    figure = Figure(figsize=(12, 7), layout="constrained")
    print(draw_spheres(figure, make_arm(robot)))
    save(figure, name)
