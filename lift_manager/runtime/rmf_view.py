"""The whole site as an adapter of Open-RMF sees it, from memory."""

from __future__ import annotations

from collections.abc import Iterable

from lift_manager.lift.rmf_view import rmf_alarms, rmf_lift
from lift_manager.plain import rmf
from lift_manager.runtime.site import Site


def rmf_site(site: Site) -> rmf.SiteView:
    """Return every lift as it is: everything up to the newest event is in it."""
    return rmf_site_of(site, (rmf_lift(site.state(name), site.config(name)) for name in site.lift_names()))


def rmf_site_of(site: Site, lifts: Iterable[rmf.LiftView], kind: type[rmf.SiteView] = rmf.SiteView) -> rmf.SiteView:
    """Return the site with these lifts, which are as they are at its newest event."""
    rules = site.rmf
    return kind(
        boot=site.boot,
        event=site.newest,
        lifts=tuple(lifts),
        end_grace_s=rules.end_grace_s,
        alarms=rmf_alarms(rules),
    )
