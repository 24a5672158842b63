"""The whole site as an adapter of Open-RMF is told of it, from memory."""

from __future__ import annotations

from collections.abc import Mapping

from lift_manager.core.facade import Facade
from lift_manager.domain.description import LiftDescription
from lift_manager.domain.rmf import rmf_lift
from lift_manager.plain.rmf import Alarms, Site


def rmf_site(facade: Facade, abouts: Mapping[str, LiftDescription] | None = None) -> Site:
    """Return every lift as it is: everything up to the newest event is in it.

    `abouts` are what `described` has returned, for whoever asks often: a lift's description never changes.
    """
    abouts = described(facade) if abouts is None else abouts
    states = ((facade.state(name), about) for name, about in abouts.items())
    lifts = tuple(rmf_lift(state, about) for state, about in states if state is not None)
    rules = facade.rmf
    return Site(
        boot=facade.boot,
        event=facade.newest,
        lifts=lifts,
        end_grace_s=rules.end_grace_s,
        alarms=Alarms(
            fire_alarm=rules.fire_alarm,
            emergency_signal=rules.emergency_signal,
            emergency_fleets=rules.emergency_fleets,
            clear_on_acknowledge=rules.clear_on_acknowledge,
        ),
    )


def described(facade: Facade) -> dict[str, LiftDescription]:
    """Return the description of every lift by its name, in the order of the site."""
    return {name: about for name in facade.lift_names() if (about := facade.describe(name)) is not None}
