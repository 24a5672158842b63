"""A few faults of a pair of real managers; a hundred are one command, see README.md beside this."""

import pytest

from tests.campaigns.takeover import campaign

pytestmark = pytest.mark.external("etcd", "etcdctl")


KINDS = ("kill", "stop_active", "handover", "kill_member")


def test_of_two_managers_one_at_a_time_commands_the_lift_whatever_becomes_of_the_other() -> None:
    tally = campaign(4, 7, kinds=KINDS, map_name="generic-registers-cluster", forked=True)
    assert tally.findings == []
    assert tally.epochs >= 3
    assert tally.presses
