"""All targets by name, but for the dashboard, which is asked over HTTP (`fuzz.dashboard`)."""

from fuzz import files, messages
from fuzz.target import Target

TARGETS: dict[str, Target] = {target.name: target for target in (*messages.targets(), *files.targets())}
