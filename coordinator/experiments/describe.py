"""The content of ``experiment.json``: what is needed to repeat an experiment, or to notice that another is meant."""

import hashlib
import os
import platform
import shlex
from importlib.metadata import version
from pathlib import Path
from typing import Any

from coordinator.experiments.experiment import Parameters
from node.fingerprint import fingerprint
from problems import BadInput, ProblemFile

_FORMAT = 1


def describe(file: ProblemFile, parameters: Parameters) -> dict[str, Any]:
    """Return the description of an experiment as plain JSON values.

    Raises:
        BadInput: if the problem file can no longer be read.
    """
    versions = fingerprint() | {"eclipse-zenoh": version("eclipse-zenoh")}
    return {
        "format": _FORMAT,
        "parameters": parameters.to_json(),
        "problem": _problem(file),
        "machine": {"cpu": versions.pop("cpu"), "cores": len(os.sched_getaffinity(0)), "system": platform.platform()},
        "versions": versions,
        "command": _command(file, parameters),
    }


def _problem(file: ProblemFile) -> dict[str, str]:
    """Describe the problem; ``sha256`` covers its fields, ``text_sha256`` the file with its comments and settings."""
    try:
        text = Path(file.name).read_text(encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{file.name}: expected a readable problem file, found {error.strerror}") from None
    digest = hashlib.sha256(text.encode()).hexdigest()
    return {"file": file.name, "kind": file.kind, "sha256": file.sha256, "text_sha256": digest, "text": text}


def _command(file: ProblemFile, parameters: Parameters) -> str:
    """Return the command that repeats the experiment, with every default spelt out."""
    words = ["supernode", "scale", file.name]
    for name, value in (parameters.to_json() | parameters.run).items():
        if name != "run":
            words += [f"--{name}", ",".join(map(str, value)) if isinstance(value, list) else str(value)]
    return shlex.join([*words, "-o", "DIR"])
