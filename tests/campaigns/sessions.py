"""Sessions in any order: more of what `tests/lift_manager/runtime/test_session_machine.py` plays a little of.

python -m tests.campaigns.sessions --examples 500 --seed 1
"""

import argparse
import logging
import sys
import time

from hypothesis import HealthCheck, seed, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.lift_manager.runtime.session_machine import SessionMachine


def main(arguments: list[str] | None = None) -> None:
    """Play so many examples; a failure is raised, made as small as it can be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--examples", type=int, default=500)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    logging.disable(logging.CRITICAL)
    many = settings(
        max_examples=given.examples,
        stateful_step_count=given.steps,
        suppress_health_check=list(HealthCheck),
        deadline=None,
        database=None,
    )
    began = time.monotonic()
    run_state_machine_as_test(seed(given.seed)(SessionMachine), settings=many)
    sys.stdout.write(f"{given.examples} examples in {time.monotonic() - began:.0f} s, 0 failed\n")


if __name__ == "__main__":
    main()
