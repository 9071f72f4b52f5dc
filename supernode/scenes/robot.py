"""The robot of an imported scene: its joints, the poses of its links, and how the problem file names it."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from problems.errors import BadInput, did_you_mean
from problems.robots.chain import chain_of
from problems.robots.loading import EXTRA, Finder, path_of, read_text, robots_of_extra, srdf_beside
from problems.robots.srdf import Srdf, read_srdf
from problems.robots.urdf import IDENTITY, Urdf, read_urdf, read_xml
from supernode.scenes.places import Floats, of_row
from supernode.scenes.scene import WORLD, Scene


@dataclass(frozen=True)
class Choice:
    """The robot as the user names it: URDF, SRDF and folders as a problem file does, relative to the current folder."""

    urdf: str | None = None
    srdf: str | None = None
    group: str | None = None
    packages: Sequence[str] | None = None


@dataclass(frozen=True, eq=False)
class RobotOfScene:
    """A robot, read without its meshes.

    Attributes:
        choice: the user's, with the URDF filled in.
        path: the URDF's file.
        urdf: what it holds.
        srdf: what the SRDF holds; nothing if there is none.
        srdf_text: the SRDF's text; None if there is none.
    """

    choice: Choice
    path: Path
    urdf: Urdf
    srdf: Srdf
    srdf_text: str | None

    @staticmethod
    def of(choice: Choice, scene: Scene) -> RobotOfScene:
        """Return the robot that the user names, or else the one of example-robot-data that the scene names.

        Raises:
            BadInput: if neither names one, or its files cannot be read.
        """
        name = choice.urdf
        if name is None:
            if scene.model is None or scene.model not in robots_of_extra():
                found = "none in the scene" if scene.model is None else repr(scene.model)
                raise BadInput(
                    f"--robot: expected the robot's URDF, found {found}; say --robot FILE.urdf, or one of "
                    "`supernode robots`"
                )
            name = f"{EXTRA}:{scene.model}"
        elif not Path(name).exists() and name in robots_of_extra():
            name = f"{EXTRA}:{name}"
        path = path_of(name, Path(), "--robot")
        urdf = read_urdf(read_text(path, "--robot"), f"--robot: {path}")
        text = _srdf_text(choice.srdf, name, path)
        whole = Choice(name, choice.srdf, choice.group, choice.packages)
        return RobotOfScene(whole, path, urdf, read_srdf(text, "--srdf"), text)

    @cached_property
    def world_frames(self) -> set[str]:
        """The frames that are the world: its own name, and the frames to which the SRDF joins the robot."""
        named = {WORLD} - set(self.urdf.links)
        if self.srdf_text is not None:
            root = read_xml(self.srdf_text, "--srdf", "an SRDF")
            named |= {each.get("parent_frame", "") for each in root.findall("virtual_joint")}
        return named

    @cached_property
    def finder(self) -> Finder:
        """Finds files that the scene names by ``package://``."""
        folders = self.choice.packages
        return Finder(self.path, None if folders is None else [Path(each).resolve() for each in folders])

    def variables(self, scene: Scene) -> tuple[list[str], str | None]:
        """Return the joints that move, and the group that they are; None if the file must list them.

        Raises:
            BadInput: if a group or joint is not the robot's.
        """
        group = self.choice.group or (scene.group if scene.group in self.srdf.groups else None)
        if group is not None:
            joints = self.srdf.joints_of(group, self.urdf)
            if scene.joints is None or self.choice.group is None or _is_unnamed(scene.joints):
                return joints, group
            if joints != scene.joints:
                raise BadInput(f"--group: expected the joints {', '.join(scene.joints)}, found {', '.join(joints)}")
            return joints, group
        named = scene.joints or list(scene.goals[0] if scene.goals else [])
        if _is_unnamed(named):
            named = self.urdf.movable[: len(named)]
        for name in named:
            if name not in self.urdf.movable:
                raise BadInput(
                    f"{self.path}: expected the joint {name!r} of the scene, found none that moves"
                    f"{did_you_mean(name, self.urdf.movable)}; is it another robot?"
                )
        return named or self.urdf.movable, None

    def within_limits(self, name: str, value: float) -> float:
        """Return a joint's value, within its limits."""
        joint = self.urdf.joints[name]
        if joint.limits is None or joint.kind == "continuous" or joint.limits[0] >= joint.limits[1]:
            return value
        return max(joint.limits[0], min(value, joint.limits[1]))

    def links_at(self, values: dict[str, float], base: Floats | None) -> dict[str, Floats]:
        """Return the place of each link in the world, (4, 4), for a state of the robot."""
        fixed = {name: self.within_limits(name, value) for name, value in values.items() if name in self.urdf.movable}
        row = IDENTITY if base is None else base[:3].reshape(12)
        chain = chain_of(self.urdf, [], fixed, row)
        return dict(zip(chain.links, map(of_row, chain.link_placements), strict=True))

    def table(self, folder: Path) -> dict[str, object]:
        """Return the fields of ``[robot]`` that name files, relative to the folder of the problem file."""
        assert self.choice.urdf is not None
        packages = self.choice.packages
        fields = {
            "urdf": relative(self.choice.urdf, folder),
            "srdf": None if self.choice.srdf is None else relative(self.choice.srdf, folder),
            "packages": None if packages is None else [relative(each, folder) for each in packages],
        }
        return {name: value for name, value in fields.items() if value is not None}


def relative(name: str, folder: Path) -> str:
    """Return the name of a file relative to another folder than the current one."""
    is_elsewhere = name.startswith(f"{EXTRA}:") or Path(name).is_absolute()
    return name if is_elsewhere else os.path.relpath(Path(name).resolve(), folder.resolve())


def _srdf_text(name: str | None, robot: str, urdf: Path) -> str | None:
    if name is None:
        found = srdf_beside(urdf) if robot.startswith(f"{EXTRA}:") else None
        return None if found is None else read_text(found, "--srdf")
    path = path_of(name, Path(), "--srdf")
    if path.suffix == ".urdf":
        beside = srdf_beside(path)
        if beside is None:
            raise BadInput(f"--srdf: expected an SRDF of {name}, found none; leave it out")
        path = beside
    return read_text(path, "--srdf")


def _is_unnamed(joints: list[str]) -> bool:
    return any(name.startswith("#") for name in joints)
