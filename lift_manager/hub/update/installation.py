"""The folder in which a site keeps the configurations of its updates.

installed.json   what is installed; the one file that decides, replaced as a whole
current          a link to the folder of the configuration that is installed; it follows `installed.json`
0/, 8/, ...      configurations: `site.yaml`, maps, and what else came with the update
staged/          an update that is being checked
incoming         its package
lock             held by the manager that runs with this folder

A crash leaves either what was installed before or what comes after it: `settle` completes the rest.
"""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from pydantic import ValidationError

from drivers.own_files import flush_names, is_shared, open_own, put_in_place, read_own, replace_file, write_own
from lift_manager.hub.errors import UpdateRefused, file_errors
from lift_manager.hub.update.installed import Installed, Version
from lift_manager.hub.update.package import SITE_FILE

CURRENT, INSTALLED, STAGED, INCOMING, LOCK = "current", "installed.json", "staged", "incoming", "lock"


class Installation:
    """The folder of a site. Every method raises UpdateRefused for what cannot be read or written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.site_file = folder / CURRENT / SITE_FILE
        """The file to be served."""
        self.incoming = folder / INCOMING

    @classmethod
    def of(cls, site_file: Path) -> Installation | None:
        """Return the installation to which a site file belongs; None if it belongs to none."""
        place = site_file.absolute().parent
        if place.name != CURRENT or not (place.parent / INSTALLED).exists():
            return None
        return cls(place.parent)

    @contextmanager
    def claimed(self) -> Iterator[None]:
        """Keep every other manager, and commands that change what is installed, out of the folder for as long as the context lasts."""
        with file_errors(self.folder, "written"):
            lock = open_own(self.folder / LOCK)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield
        except BlockingIOError as error:
            raise UpdateRefused(f"a manager runs with {self.folder}; stop it first") from error
        finally:
            os.close(lock)

    def read(self) -> Installed:
        """Return what is installed."""
        if is_shared(self.folder):
            text = f"{self.folder} can be written by others, who could change the configuration; `chmod go-w {self.folder}`"
            raise UpdateRefused(text)
        path = self.folder / INSTALLED
        try:
            return Installed.model_validate_json(read_own(path)[0])
        except (OSError, ValidationError) as error:
            advice = "restore a copy of it, or begin again with `lift-manager hub update adopt`"
            raise UpdateRefused(f"{path} cannot be used ({error}); {advice}") from error

    def settle(self) -> None:
        """Complete what a crash has interrupted."""
        for _ in self.settling(self.read()):
            pass

    def write(self, installed: Installed) -> None:
        """Install something else."""
        for _ in self.writing(installed):
            pass

    def writing(self, installed: Installed) -> Iterator[None]:
        """Do the same step by step; each leaves the disk as it is after a crash at this point."""
        with file_errors(self.folder, "written"):
            replace_file(self.folder / INSTALLED, installed.model_dump_json(indent=1).encode() + b"\n")
        yield
        yield from self.settling(installed)

    def settling(self, installed: Installed) -> Iterator[None]:
        """Let the link follow what is installed, and remove what nobody needs any more, step by step."""
        link, target = self.folder / CURRENT, str(installed.current.number)
        with file_errors(self.folder, "written"):
            if not link.is_symlink() or str(link.readlink()) != target:
                temporary = self.folder / f"{CURRENT}.new"
                temporary.unlink(missing_ok=True)
                temporary.symlink_to(target)
                yield
                put_in_place(temporary, link)
                yield
            kept = {target, str(installed.before.number) if installed.before else target}
            for other in _configurations(self.folder):
                if other.name not in kept:
                    shutil.rmtree(other)
                    yield
            self.incoming.unlink(missing_ok=True)

    def unpack(self, files: Mapping[str, bytes]) -> Path:
        """Write the files of an update where it is checked, on the disk for good; returns the folder."""
        staged = self.folder / STAGED
        with file_errors(staged, "written"):
            shutil.rmtree(staged, ignore_errors=True)
            folders = {staged}
            for name, content in files.items():
                path = staged / name
                path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                folders |= {folder for folder in path.parents if folder.is_relative_to(staged)}
                write_own(path, content)
            for folder in folders:
                flush_names(folder)
        return staged

    def keep(self, staged: Version, installed: Installed) -> None:
        """Give what was checked its place, from which it can be applied."""
        if staged.number in (installed.current.number, installed.before.number if installed.before else -1):
            raise UpdateRefused(f"update {staged.number} is installed, and cannot be replaced")
        self._place(staged.number)

    def begin(self, files: Mapping[str, bytes]) -> None:
        """Make the installation, with the configuration that a person has written."""
        if (self.folder / INSTALLED).exists():
            raise UpdateRefused(f"{self.folder} is an installation already; serve {self.site_file}")
        with file_errors(self.folder, "made"):
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        first = Installed()
        self.unpack(files)
        self._place(first.current.number)
        self.write(first)

    def _place(self, number: int) -> None:
        with file_errors(self.folder, "written"):
            shutil.rmtree(self.folder / str(number), ignore_errors=True)
            put_in_place(self.folder / STAGED, self.folder / str(number))

    def drop_staged(self) -> None:
        """Remove an update that is not kept."""
        shutil.rmtree(self.folder / STAGED, ignore_errors=True)
        with suppress(OSError):  # the next start removes it
            self.incoming.unlink(missing_ok=True)


def _configurations(folder: Path) -> list[Path]:
    found = (path for path in folder.iterdir() if path.is_dir() and not path.is_symlink())
    return [path for path in found if path.name.isdigit() or path.name == STAGED]
