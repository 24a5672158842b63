"""What `lift-manager serve` needs for one of two machines."""

from __future__ import annotations

from lift_manager.cli.common import fail, store_path_of
from lift_manager.cluster.connect import certificates_of, cluster_of, machine_of
from lift_manager.cluster.errors import ClusterError
from lift_manager.cluster.solo_file import SoloFile
from lift_manager.config.load import LoadedSite
from lift_manager.store.errors import StoreError
from lift_manager.store.retention import Limits
from lift_manager.store.site import open_copy
from lift_manager.takeover import Alone, ThisMachine


def this_machine(loaded: LoadedSite) -> ThisMachine:
    """Open the copy of the store on this machine, or report why it cannot be used and exit with 1."""
    cluster, journal = cluster_of(loaded), loaded.site.journal
    path = store_path_of(loaded)
    file = SoloFile(path)
    try:
        machine, certificates = machine_of(cluster), certificates_of(cluster, loaded.path.parent)
        disk = open_copy(path, loaded.site.name, Limits(journal.keep_days, journal.max_mb))
        solo = file.read()
    except (ClusterError, StoreError) as error:
        raise fail(str(error)) from error
    if solo is not None and solo.machine != machine:
        raise fail(f"{solo.text}, and this machine is {machine}: {file.path} is of another one")
    return ThisMachine(machine, disk, str(path), certificates, None if solo is None else Alone(solo, file))
