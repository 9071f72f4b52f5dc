"""Whether this user may make namespaces; many containers forbid it."""

import shutil
import subprocess

import pytest


def _are_allowed():
    command = ["unshare", "--user", "--map-current-user", "--net", "true"]
    return (
        shutil.which("unshare") is not None
        and subprocess.run(command, check=False, capture_output=True).returncode == 0
    )


needs_namespaces = pytest.mark.skipif(not _are_allowed(), reason="needs user namespaces (unshare --user --net)")
