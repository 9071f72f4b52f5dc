"""Read what a robot's problem file names: URDF, SRDF and meshes. Afterwards no field names a file.

This is the only module here that opens files, on behalf of whoever submits a problem; see `Problem.gather`.
"""

from __future__ import annotations

import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from problems.angles import in_unit
from problems.errors import BadInput, did_you_mean
from problems.plain_values import is_file
from problems.robots.meshes import UNSCALED, Scale, encode_mesh, read_mesh, scaled_name
from problems.robots.urdf import Geometry, Urdf, completed, read_urdf

Fields = dict[str, Any]

EXTRA = "example-robot-data"
_PREFIX = f"{EXTRA}:"
_MOST_PLACES = 4  # that a message lists
_REMOTE = ("http:", "https:", "ftp:")


def gather_robot(fields: Fields, folder: Path) -> Fields:
    """Return a problem's fields with the files of ``robot`` and of mesh obstacles and attached meshes read.

    ``robot.urdf`` and ``robot.srdf`` become XML texts, and ``robot.meshes`` maps the names of meshes to texts
    (`problems.robots.meshes`). A robot that has been read before stays as it is. Wrong types do not raise: validation
    reports them.

    Args:
        fields: plain values, not yet validated.
        folder: the problem file's folder.

    Raises:
        BadInput: if a file cannot be read; the message names the field, the file and where it was looked for.
    """
    robot = fields.get("robot")
    if not isinstance(robot, dict) or not isinstance(robot.get("urdf"), str):
        return fields
    gathered = gather_description(robot, folder)
    meshes = dict(gathered.get("meshes", {}))
    for name in ("obstacles", "attached"):
        for number, table in enumerate(_tables(fields.get(name))):
            _gather_shape(table, folder, f"{name}[{number}].file", meshes)
    return {**fields, "robot": {**gathered, "meshes": meshes}}


def is_read(robot: Any) -> bool:
    """Return whether ``robot`` is a table ``[robot]`` whose URDF has been read."""
    return isinstance(robot, dict) and "<" in str(robot.get("urdf"))


def held_in_radians(robot: Fields) -> Fields:
    """Return ``[robot]`` of a file in degrees, its URDF read, with ``fixed`` in radians but for joints that slide."""
    fixed = robot.get("fixed")
    if not isinstance(fixed, dict):
        return robot
    joints = read_urdf(robot["urdf"]).joints
    slide = {name for name, joint in joints.items() if joint.kind == "prismatic"}
    turned = {name: in_unit("rad", value, f"robot.fixed.{name}") for name, value in fixed.items() if name not in slide}
    return {**robot, "fixed": {**fixed, **turned}}


def gather_description(robot: Fields, folder: Path) -> Fields:
    """Return the fields of ``[robot]`` with URDF, SRDF and meshes read; see `gather_robot`."""
    if is_read(robot):
        return robot
    path = path_of(robot["urdf"], folder, "robot.urdf")
    text = read_text(path, "robot.urdf")
    urdf = read_urdf(text, f"robot.urdf: {path}")
    packages = robot.get("packages")
    if packages is not None and not (isinstance(packages, list) and all(isinstance(each, str) for each in packages)):
        return robot  # validation reports it
    finder = Finder(path, None if packages is None else [(folder / each).resolve() for each in packages])
    rest = {name: value for name, value in robot.items() if name != "packages"}
    gathered = {**rest, "urdf": completed(text), "meshes": gather_meshes(urdf, finder)}
    srdf = _srdf_path(robot, path, folder)
    return gathered if srdf is None else {**gathered, "srdf": read_text(srdf, "robot.srdf")}


def gather_meshes(urdf: Urdf, finder: Finder) -> dict[str, str]:
    """Return the meshes of all collision elements as texts, by the names under which `mesh_of` finds them.

    Raises:
        BadInput: if one is missing or cannot be read.
    """
    meshes: dict[str, str] = {}
    scales: dict[str, Scale] = {}
    for link, geometry in uses_of_meshes(urdf):
        name = geometry.mesh
        if scales.setdefault(name, geometry.scale) != geometry.scale:
            name = scaled_name(geometry.mesh, geometry.scale)
        if name not in meshes:
            where = f"robot.urdf: {finder.urdf}: link {link!r}"
            path = finder.find(geometry.mesh, where)
            meshes[name] = encode_mesh(*read_mesh(path, geometry.scale, where))
    return meshes


def uses_of_meshes(urdf: Urdf) -> Iterator[tuple[str, Geometry]]:
    """Yield the name of the link and the collision element, for each that is a mesh."""
    for link in urdf.links.values():
        yield from ((link.name, each) for each in link.collisions if each.shape == "mesh")


@dataclass(frozen=True)
class Finder:
    """Finds the files that a URDF names.

    Attributes:
        urdf: the URDF's file.
        packages: the folders in which ``package://`` looks; None for the URDF's folder and those above it.
    """

    urdf: Path
    packages: list[Path] | None = None

    def find(self, name: str, where: str) -> Path:
        """Return the file that a name stands for.

        Raises:
            BadInput: if there is none; the message says where it was looked for.
        """
        if name.lower().startswith(_REMOTE):
            raise BadInput(f"{where}: expected a mesh on this computer, found {name}; save it beside the URDF")
        places = list(dict.fromkeys(self._places(name)))
        for place in places:
            if is_file(place):
                return place
        listed = ", ".join(map(str, places[:_MOST_PLACES]))
        more = f" and {len(places) - _MOST_PLACES} more places" if len(places) > _MOST_PLACES else ""
        mend = '; say packages = ["FOLDER"] in [robot], the folder that holds the package' if "package:" in name else ""
        raise BadInput(f"{where}: expected the mesh {name}, found no file {listed}{more}{mend}")

    def _places(self, name: str) -> Iterator[Path]:
        scheme, separator, rest = name.partition("://")
        if not separator:
            yield self.urdf.parent / name
        elif scheme == "file":
            path = Path(unquote(rest))
            yield path if path.is_absolute() else self.urdf.parent / path
        else:
            # The folder of a package is found by its name below a root, or is the root itself.
            package, _, inner = rest.partition("/")
            own = self.urdf.parent.resolve()
            roots = [own, *own.parents] if self.packages is None else self.packages
            for root in roots:
                yield root / package / inner
                if root.name == package:
                    yield root / inner


def _gather_shape(table: Fields, folder: Path, where: str, meshes: dict[str, str]) -> None:
    """Read the file of a mesh obstacle or attached mesh into ``meshes``, under `shape_name`."""
    file, scale = table.get("file"), table.get("scale", 1.0)
    factors = [scale] * 3 if isinstance(scale, int | float) else scale
    is_valid = (
        isinstance(factors, list) and len(factors) == 3 and all(isinstance(each, int | float) for each in factors)
    )
    if table.get("shape") != "mesh" or not isinstance(file, str) or not is_valid:
        return  # no mesh, or validation reports it
    x, y, z = (float(each) for each in factors)
    name = shape_name(file, (x, y, z))
    path = folder / file
    if not is_file(path):
        raise BadInput(f"{where}: expected a mesh, found no file {path}")
    text = encode_mesh(*read_mesh(path, (x, y, z), where))
    if meshes.setdefault(name, text) != text:
        raise BadInput(f"{where}: expected another name than that of a mesh in the URDF, found {file}; rename {path}")


def shape_name(file: str, scale: Scale) -> str:
    """Return the name in ``robot.meshes`` of a mesh that an obstacle or attached thing names, with its scale."""
    return file if scale == UNSCALED else scaled_name(file, scale)


def _tables(value: Any) -> list[Fields]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []


# Files ----------------------------------------------------------------------------------------------------------------
def read_text(path: Path, where: str) -> str:
    """Return a file's text.

    Raises:
        BadInput: if it cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInput(f"{where}: expected a file, found no file {path}") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{where}: expected a text file, found {path}: {error}") from None


def path_of(name: str, folder: Path, where: str) -> Path:
    """Return the path of a URDF or SRDF: a file relative to a folder, or a robot of example-robot-data.

    Raises:
        BadInput: if it is a robot that example-robot-data does not have.
    """
    if not name.startswith(_PREFIX):
        return folder / name
    wanted, robots = name.removeprefix(_PREFIX), robots_of_extra()
    home = home_of_extra()
    inner = home / wanted if home is not None else None
    if inner is not None and "/" in wanted and is_file(inner):
        return inner
    if not robots:
        raise BadInput(
            f"{where}: expected the robots of {EXTRA}, found no such package; pip install 'supernode[robots]'"
        )
    if wanted not in robots:
        raise BadInput(
            f"{where}: expected a robot of {EXTRA}, found {wanted!r}{did_you_mean(wanted, robots)}; "
            "`supernode robots` lists them"
        )
    return robots[wanted]


def home_of_extra() -> Path | None:
    """Return the folder of all robots of example-robot-data; None if it is not installed."""
    home = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share" / EXTRA / "robots"
    return home if home.is_dir() else None


def robots_of_extra() -> dict[str, Path]:
    """Return the URDFs of example-robot-data by short names.

    A name is that of the file without ``.urdf``, and without ``_robot`` where no other file has that name; for a name
    that several folders have, the folder's without ``_description``, then a hyphen and that name. A folder's own name
    stands for its only robot.
    """
    home = home_of_extra()
    paths = sorted(home.glob("*/*/*.urdf")) if home is not None else []
    whole = [path.stem for path in paths]
    stems = [stem if stem.removesuffix("_robot") in whole else stem.removesuffix("_robot") for stem in whole]
    robots: dict[str, Path] = {}
    for path, stem in zip(paths, stems, strict=True):
        robots[stem if stems.count(stem) == 1 else f"{_folder_name(path)}-{stem}"] = path
    for path in paths:
        alone = sum(other.parents[1] == path.parents[1] for other in paths) == 1
        if alone and _folder_name(path) not in robots:
            robots[_folder_name(path)] = path
    return robots


def _folder_name(path: Path) -> str:
    return path.parents[1].name.removesuffix("_description").removesuffix("_data")


def _srdf_path(robot: Fields, urdf: Path, folder: Path) -> Path | None:
    """Return the path of the SRDF: the file's, or for a robot of example-robot-data the one of its URDF's name."""
    named = robot.get("srdf")
    if isinstance(named, str):
        if not named.startswith(_PREFIX):
            return folder / named
        urdf = path_of(named, folder, "robot.srdf")
        if urdf.suffix == ".srdf":
            return urdf
        found = srdf_beside(urdf)
        if found is None:
            raise BadInput(f"robot.srdf: expected an SRDF of {named}, found none; leave srdf out")
        return found
    is_of_extra = robot["urdf"].startswith(_PREFIX)
    return srdf_beside(urdf) if is_of_extra and named is None else None


def srdf_beside(urdf: Path) -> Path | None:
    """Return the SRDF of the same name as a URDF of example-robot-data, if that is where it is, and there is one."""
    home = home_of_extra()
    if home is None or home not in urdf.parents:
        return None
    stem = urdf.stem.removesuffix("_robot")
    path = urdf.parents[1] / "srdf" / f"{stem}.srdf"
    return path if path.is_file() else None
