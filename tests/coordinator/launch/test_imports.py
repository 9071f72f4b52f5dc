"""What a zygote imports before it forks: all that its children need."""

import subprocess
import sys


def test_a_coordinator_imports_nothing_itself(tmp_path):
    """It would share the cores with all nodes meanwhile, while jobs wait for it."""
    script = (
        "import sys\n"
        "from pathlib import Path\n"
        "from coordinator.launch.imports import import_all\n"
        "import_all([], with_coordinator=True)\n"
        "before = set(sys.modules)\n"
        "import coordinator.launch.router, coordinator.service.launched\n"
        "from coordinator.store.database import url_in\n"
        "from coordinator.store.job_store import Store\n"
        "Store(url_in(Path(sys.argv[1]))).close()\n"
        "late = set(sys.modules) - before\n"
        "assert not late, late\n"
    )
    done = subprocess.run([sys.executable, "-c", script, tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
