"""Checks a map across its fields and reports every problem at once, each with its remedy.

A map is read in three steps: the schema checks each field, `check_places.find_unreadable` finds addresses that are
no places, and `check` examines the rest.
"""

from __future__ import annotations

from register_maps.check_arbitration import check_arbitration
from register_maps.check_blocks import check_blocks, check_shared_words
from register_maps.check_calls import check_calls
from register_maps.check_cautions import check_cautions
from register_maps.check_claims import check_claims
from register_maps.check_commands import check_commands
from register_maps.check_confirm import check_confirm
from register_maps.check_evidence import check_evidence
from register_maps.check_link import check_link
from register_maps.check_places import check_served
from register_maps.check_signals import check_signals
from register_maps.errors import Problem
from register_maps.schema import RegisterMap

__all__ = ["Problem", "check"]


def check(source: RegisterMap) -> list[Problem]:
    """Return every problem of a map whose addresses can all be read."""
    problems = [
        *check_served(source),
        *check_link(source),
        *check_signals(source),
        *check_commands(source),
        *check_confirm(source),
        *check_claims(source),
        *check_calls(source),
        *check_shared_words(source),
        *check_blocks(source),
        *check_arbitration(source),
        *check_evidence(source),
    ]
    wrong = {str(problem.path[1]) for problem in problems if problem.path[0] == "signals" and len(problem.path) > 1}
    return [*problems, *check_cautions(source, wrong)]
