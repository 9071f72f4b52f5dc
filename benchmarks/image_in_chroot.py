"""Carry out the steps of the Dockerfile in bare Debian roots, and solve an example in the image that results.

Usage: make image  (as root, on Debian with debootstrap; some minutes)

No container engine is needed: each stage is a copy of a root that debootstrap makes, and RUN is chroot. What stays
untested is what an engine adds: layers, volumes and health checks.
"""

import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BASE = "python3,python3-venv,ca-certificates"  # what the image python:3.11-slim has that matters here
RELEASE = "bookworm"  # its Python is 3.11
_CHROOT = shutil.which("chroot", path="/usr/sbin:/sbin") or "chroot"  # the image's PATH need not lead there
EXAMPLE = "examples/arm-ik.toml"
_PATH = "/usr/local/bin:/usr/local/sbin:/usr/sbin:/usr/bin:/sbin:/bin"  # of the image python:3.11-slim


def steps_of(dockerfile: str) -> Iterator[tuple[str, str]]:
    """Yield each instruction of a Dockerfile with its text; lines that a backslash joins are one."""
    text = re.sub(r"^#.*\n", "", dockerfile, flags=re.MULTILINE)
    for line in re.sub(r"\\\n\s*", "", text).splitlines():
        if line.strip():
            word, _, rest = line.strip().partition(" ")
            yield word, rest


class Stage:
    """A root in which instructions are carried out."""

    def __init__(self, base: Path, folder: Path) -> None:
        self.folder, self.user = folder, "root"
        self.variables = {"PATH": _PATH, "HOME": "/root", "LANG": "C.UTF-8"}
        subprocess.run(["cp", "--archive", base, folder], check=True)

    def mount(self) -> None:
        """Mount what processes need; `close` gives it back, also if this was interrupted."""
        for name in ("proc", "dev"):
            # A slave: what is unmounted here stays mounted on this machine.
            subprocess.run(["mount", "--rbind", "--make-rslave", f"/{name}", self.folder / name], check=True)

    def run(self, command: str, cwd: str = "/") -> None:
        """Run a command in the root, as its user."""
        words = [_CHROOT, f"--userspec={self.user}", str(self.folder), "sh", "-ec", f"cd {cwd}; {command}"]
        subprocess.run(words, env=self.variables, check=True)

    def set(self, text: str) -> None:
        """Carry out an ENV."""
        for word in shlex.split(text):
            name, _, value = word.partition("=")
            self.variables[name] = value.replace("$PATH", self.variables["PATH"])

    def copy(self, text: str, folders: dict[str, Path]) -> None:
        """Carry out a COPY, from the repository or another stage."""
        options: list[str] = []
        *sources, target = shlex.split(text)
        while sources[0].startswith("--"):
            options.append(sources.pop(0))
        values = dict(option.removeprefix("--").split("=") for option in options)
        origin = folders[values.get("from", "repository")]
        to = self.folder / target.lstrip("/")
        to.mkdir(parents=True, exist_ok=True)
        for source in sources:
            whole = (origin / source.lstrip("/")).is_dir()
            path = origin / source.lstrip("/")
            subprocess.run(["cp", "--archive", f"{path}/." if whole else path, to], check=True)
        if "chown" in values:
            self.run(f"chown --recursive {values['chown']}: {target}")

    def close(self) -> None:
        """Give back what was mounted."""
        for name in ("proc", "dev"):
            if os.path.ismount(self.folder / name):
                subprocess.run(["umount", "--recursive", "--lazy", self.folder / name], check=True)


def bare(folder: Path) -> None:
    """Make a bare Debian with Python, and this machine's way to the network."""
    subprocess.run(["debootstrap", "--variant=minbase", f"--include={BASE}", RELEASE, folder], check=True)
    (folder / "usr/local/bin/python").symlink_to("/usr/bin/python3")
    for name in ("etc/resolv.conf", "etc/pip.conf", "etc/ssl/certs/ca-certificates.crt"):
        if Path("/", name).exists():
            shutil.copy(Path("/", name), folder / name)


def build(folder: Path, stages: list[Stage]) -> Stage:
    """Carry out the steps; add each stage to ``stages``, and return the last one, the image."""
    folders = {"repository": folder / "repository"}
    for word, text in steps_of((ROOT / "Dockerfile").read_text()):
        print(f"{word} {text}"[:150], flush=True)
        if word == "FROM":
            name = text.partition(" AS ")[2] or "image"
            folders[name] = folder / name
            stages.append(image := Stage(folder / "base", folder / name))
            image.mount()
            image.set(" ".join(f"{key}={value}" for key, value in os.environ.items() if key.startswith("PIP_")))
        elif word == "RUN":
            image.run(text)
        elif word == "ENV":
            image.set(text)
        elif word == "COPY":
            image.copy(text, folders)
        elif word == "USER":
            image.user = text
    return stages[-1]


def main() -> None:
    """Build the image in a folder of its own, and solve the example in it."""
    if os.geteuid() != 0 or shutil.which("debootstrap") is None:
        sys.exit("expected root and debootstrap: apt-get install debootstrap")
    with tempfile.TemporaryDirectory(prefix="image-") as name:
        folder, stages = Path(name), list[Stage]()
        subprocess.run(["git", "clone", "--quiet", "--depth=1", f"file://{ROOT}", folder / "repository"], check=True)
        bare(folder / "base")
        try:
            image = build(folder, stages)
            home = image.folder / "home/supernode"
            shutil.copy(ROOT / EXAMPLE, home)
            image.variables["HOME"] = "/home/supernode"
            image.run("supernode solve arm-ik.toml --seed 1", "/home/supernode")
        finally:
            for stage in stages:
                stage.close()
    print("the image solves the example")


if __name__ == "__main__":
    main()
