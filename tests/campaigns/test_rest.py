"""The campaign on the REST interface, on a small scale: every operation, as every caller."""

from lift_manager.api.roles import Role


def test_requests_made_from_the_document_find_nothing_undocumented_and_nothing_beyond_a_role() -> None:
    # it imports schemathesis, which takes a fifth of a second in each worker where this is only collected
    from tests.campaigns.rest import campaign

    found = campaign(seconds=0, first_seed=1, examples=1)
    assert found.findings == []
    asked = {(caller, label) for caller, label, _ in found.asked}
    operations = {label for _, label in asked}
    assert len(operations) >= 25
    assert asked == {(caller, label) for caller in ("open", "no key", *Role) for label in operations}
    statuses = {(caller, status) for caller, _, status in found.asked}
    closed = {status for caller, label, status in found.asked if caller == "no key" and "/lift" in label}
    assert closed <= {400, 401}
    assert {("viewer", 403), ("robot", 403), ("robot", 200), ("operator", 200), ("open", 200)} <= statuses
