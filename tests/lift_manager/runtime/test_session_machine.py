"""No order of requests, faults and restarts leads to two holders, to a press that nobody asked for, or to a lift held for ever."""

import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import run_state_machine_as_test

from tests.lift_manager.runtime.session_machine import SessionMachine


@pytest.mark.timeout(600)  # seconds of a whole processor; what hangs ends by the limits of virtual time
def test_callers_faults_and_restarts_in_any_order() -> None:
    few = settings(max_examples=4, stateful_step_count=20, suppress_health_check=list(HealthCheck))
    run_state_machine_as_test(SessionMachine, settings=few)
