"""The namespaces of a killed command are recognised, and nobody else's."""

from tests.campaigns.takeover_network import leftovers


def test_the_namespaces_of_commands_that_do_not_run_any_more_are_left_over() -> None:
    names = [f"takeover-{process}-1003-{machine}" for process in (7, 8) for machine in ("switch", "north", "field")]
    assert leftovers(names, lambda process: process == 7) == {"takeover-8-1003"}


def test_namespaces_of_other_names_are_not_ours() -> None:
    names = [
        "takeover",
        "takeover-8",
        "takeover-8-1-lan",
        "takeover-x-1-north",
        "my-takeover-8-1-north",
        "nato-8-1-field",
    ]
    assert leftovers(names, lambda _: False) == set()
