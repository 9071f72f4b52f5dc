"""What the image installs is pinned: the lock has all that pyproject.toml asks for, and nothing that is not hashed."""

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
LOCK = (ROOT / "requirements.lock").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
_ENTRY = re.compile(r"([a-z0-9-]+)==([^ ;]+)((?: \\\n    --hash=sha256:[0-9a-f]{64})+)\n")


def pinned(lock):
    """Versions by name; each line that is no comment must belong to an entry with hashes."""
    lines = re.sub(r"^ *#.*\n", "", lock, flags=re.MULTILINE)
    assert _ENTRY.sub("", lines) == "", "only names, versions and hashes"
    return {name: version for name, version, _ in _ENTRY.findall(lines)}


def needed():
    """What the image needs: to run, and to build this project."""
    (extras,) = re.findall(r"^IMAGE_EXTRAS := (.+)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    of_extras = PROJECT["project"]["optional-dependencies"]
    words = [*PROJECT["project"]["dependencies"], *PROJECT["build-system"]["requires"]]
    return [Requirement(word) for word in (*words, *(each for extra in extras.split() for each in of_extras[extra]))]


def missing(lock):
    """What the lock lacks, or has in a version that pyproject.toml refuses; `make lock` mends it."""
    found = pinned(lock)
    names = {each: found.get(canonicalize_name(each.name)) for each in needed()}
    return {str(each) for each, version in names.items() if version is None or not each.specifier.contains(version)}


def test_the_lock_has_all_that_the_image_needs():
    assert missing(LOCK) == set()


def test_a_lock_that_is_stale_is_noticed():
    assert missing(re.sub(r"^numpy==.*(\n    .*)+\n", "", LOCK, flags=re.MULTILINE)) == {"numpy>=2.0"}
    assert missing(re.sub(r"^numpy==\S+", "numpy==1.26.4", LOCK, flags=re.MULTILINE)) == {"numpy>=2.0"}


def test_the_lock_names_no_package_index():
    assert not re.search(r"://|--[a-z-]*(index|find-links)|^-", LOCK, re.MULTILINE)


def test_the_image_installs_nothing_that_is_not_in_the_lock():
    installs = re.findall(r"pip install (.+?)(?: &&| \\)", (ROOT / "Dockerfile").read_text())
    libraries, project = installs
    assert "--require-hashes" in libraries
    assert "--requirement /src/requirements.lock" in libraries
    assert {"--no-deps", "--no-build-isolation"} <= set(project.split())
