"""Keeps on the disk of a machine that it goes on alone."""

from __future__ import annotations

from pathlib import Path

from drivers.own_files import flush_names, read_own, replace_file
from lift_manager.cluster.content import Solo, decode_solo, encode_solo
from lift_manager.cluster.errors import ClusterUnusable
from lift_manager.cluster.etcd import Entry


class SoloFile:
    """The decision that one machine goes on alone; no file without one. Every method may block."""

    def __init__(self, store: Path) -> None:
        """`store` is the file in which this machine keeps its copy."""
        self.path = store.with_name(f"{store.name}.solo")

    def read(self) -> Solo | None:
        """Return the decision, if there is one. Raises ClusterUnusable: a manager that cannot read it must not guess."""
        try:
            content, _ = read_own(self.path)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise ClusterUnusable(
                f"{self.path} cannot be read ({error}); it says that this machine goes on alone"
            ) from error
        try:
            return decode_solo([Entry(str(self.path), content, 0)])
        except ClusterUnusable as error:
            raise ClusterUnusable(
                f"{self.path}, which says that this machine goes on alone, is damaged or of another version. See to it that the other machine is"
                " off or has ended, remove this file, and decide again which machine continues"
            ) from error

    def write(self, solo: Solo) -> None:
        """Replace the decision durably. Raises ClusterUnusable."""
        try:
            replace_file(self.path, encode_solo(solo))
        except OSError as error:
            raise ClusterUnusable(f"{self.path} cannot be written: {error}") from error

    def remove(self) -> None:
        """Remove the decision durably. Raises ClusterUnusable."""
        try:
            self.path.unlink(missing_ok=True)
            flush_names(self.path.parent)
        except OSError as error:
            raise ClusterUnusable(f"{self.path} cannot be removed: {error}") from error
