"""A manager that is alone loads nothing of what two machines need."""

import subprocess
import sys

PROGRAM = """
import sys
import lift_manager.cli.serve
print([name for name in ("httpx", "lift_manager.takeover", "lift_manager.cluster.etcd") if name in sys.modules])
"""


def test_a_manager_that_is_alone_loads_no_client_of_etcd() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout == "[]\n"
