"""The whole site as an adapter of Open-RMF is told of it, from memory."""

from __future__ import annotations

from collections.abc import Mapping

from lift_manager.core.facade import Facade
from lift_manager.domain.description import LiftDescription
from lift_manager.domain.rmf import RmfSite, rmf_lift


def rmf_site(facade: Facade, abouts: Mapping[str, LiftDescription] | None = None) -> RmfSite:
    """Return every lift as it is: everything up to the newest event is in it.

    `abouts` are what `described` has returned, for whoever asks often: a lift's description never changes.
    """
    abouts = described(facade) if abouts is None else abouts
    states = ((facade.state(name), about) for name, about in abouts.items())
    lifts = tuple(rmf_lift(state, about) for state, about in states if state is not None)
    return RmfSite(boot=facade.boot, event=facade.newest, lifts=lifts, rules=facade.rmf)


def described(facade: Facade) -> dict[str, LiftDescription]:
    """Return the description of every lift by its name, in the order of the site."""
    return {name: about for name in facade.lift_names() if (about := facade.describe(name)) is not None}
