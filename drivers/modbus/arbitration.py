"""Follows whom a controller obeys that decides so itself, and what our writes claim for it. Pure."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from register_maps.arbitration import NO_CLAIM, Claim, claim_alone
from register_maps.codec import Value

SIGNALS = frozenset({"epoch", "owner"})


class Arbitration:
    """What one manager claims of one controller, and what the controller shows of it."""

    def __init__(self, claim: Claim | None, set_claim: Callable[[Claim], None], report: Callable[[str], None]) -> None:
        """`claim` is None for a manager without a cluster; `report` takes what people should know, once."""
        self.claim = claim or claim_alone(NO_CLAIM)
        self.refusal: str | None = None
        """Why nothing may be pressed: the controller would not obey."""
        self._is_settled = claim is not None
        self._set_claim = set_claim
        self._report = report
        set_claim(self.claim)

    def update(self, values: Mapping[str, Value]) -> None:
        """Take the signals of a reading in which one of `SIGNALS` has changed."""
        epoch, owner = values["epoch"], values["owner"]
        if not isinstance(epoch, int) or not isinstance(owner, int):
            raise TypeError(f"epoch {epoch!r} and owner {owner!r} are not numbers, which a checked map rules out")
        obeyed = Claim(epoch, owner)
        if not self._is_settled:
            # once: whoever claims more later is to be obeyed alone
            self.claim, self._is_settled = claim_alone(obeyed), True
            self._set_claim(self.claim)
        before, self.refusal = self.refusal, self._refusal(obeyed)
        if self.refusal is not None and before is None:
            self._report(self.refusal)

    def _refusal(self, obeyed: Claim) -> str | None:
        if self.claim.is_obeyed_after(obeyed):
            return None
        return (
            f"the controller obeys epoch {obeyed.epoch} of machine {obeyed.owner}, and ignores this manager, which commands in epoch"
            f" {self.claim.epoch} as machine {self.claim.owner}: if no other manager commands the lift, make etcd begin above that with"
            f" `lift-manager cluster init --replace --epoch {obeyed.epoch}`, or without a cluster start this manager again"
        )
