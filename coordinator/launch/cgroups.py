"""Read how much the control groups of this process still allow, in cgroup v2 and in the controllers of v1 (cgroups(7)).

Functions take the folder in which /proc and /sys are looked for, so that tests can bring their own.
"""

from collections.abc import Iterator
from pathlib import Path

ROOT = Path("/")
_UNLIMITED = 1 << 62  # v1 states "no limit" as a number of about this size


def processes_left(root: Path = ROOT) -> int | None:
    """Return how many more threads the groups of this process allow; None if they set no limit."""
    return min(_left("pids", "pids.max", "pids.current", root), default=None)


def memory_left(root: Path = ROOT) -> int | None:
    """Return how many more bytes the groups of this process allow; None if they set no limit.

    Cached file pages that the kernel can drop count as free.
    """
    v2 = _left("memory", "memory.max", "memory.current", root)
    v1 = _left("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", root)
    return min((*v2, *v1), default=None)


def _left(controller: str, limit_file: str, usage_file: str, root: Path) -> Iterator[int]:
    """Yield what is left in each limited group, from the process's own up to the outermost visible one."""
    for group in _groups(controller, root):
        limit = _number(group / limit_file)
        if limit is not None and limit < _UNLIMITED:
            used = _number(group / usage_file) or 0
            yield max(0, limit - used + (_droppable(group) if controller == "memory" else 0))


def _groups(controller: str, root: Path) -> Iterator[Path]:
    """Yield the folders of the process's group and of its ancestors, in each hierarchy that may have the controller."""
    paths = _paths(root)
    for line in _lines(root / "proc/self/mountinfo"):
        left, _, right = line.partition(" - ")
        mounted, mount_point = left.split()[3:5]  # the part of the hierarchy that is mounted, and where
        kind, _, options = right.split()
        if kind not in ("cgroup", "cgroup2") or (kind == "cgroup" and controller not in options.split(",")):
            continue
        path = paths.get("" if kind == "cgroup2" else controller)
        if path is None:
            continue
        inner = Path(path.removeprefix(mounted.rstrip("/")).lstrip("/"))
        top = root / mount_point.lstrip("/")
        yield from (top / each for each in (inner, *inner.parents))


def _paths(root: Path) -> dict[str, str]:
    """Return the group of this process in each hierarchy, by controller; "" is that of v2."""
    paths: dict[str, str] = {}
    for line in _lines(root / "proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        paths |= dict.fromkeys(controllers.split(","), path)
    return paths


def _droppable(group: Path) -> int:
    """Return the bytes of cached files that no process has used lately."""
    statistics = dict(line.split(maxsplit=1) for line in _lines(group / "memory.stat"))
    return int(statistics.get("total_inactive_file", statistics.get("inactive_file", "0")))


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def _number(path: Path) -> int | None:
    """Return the number in a file; None if there is no such file, or it says "max"."""
    text = "".join(_lines(path))
    return int(text) if text.isdigit() else None
