"""The adapter in the manager's own process, over DDS."""

from __future__ import annotations

from lift_manager.rmf.dds import Dds
from lift_manager.rmf.local_manager import LocalManager
from lift_manager.rmf.ros_settings import RosSettings
from lift_manager.rmf.run import RunningAdapter
from lift_manager.runtime.site import Site


def joined(site: Site, settings: RosSettings) -> RunningAdapter:
    """Join Open-RMF with the lifts of a manager, on the running loop. Raises DdsError."""
    adapter = RunningAdapter(
        lambda hears, deliver: Dds(settings, hears, deliver),
        lambda: LocalManager(site),
        use_sim_time=settings.use_sim_time,
        adapter_id=settings.adapter,
    )
    adapter.open()
    return adapter
