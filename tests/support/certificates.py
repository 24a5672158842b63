"""Certificates for tests: made in every run, kept in a temporary folder, never in the repository."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import trustme


@dataclass(frozen=True)
class Shown:
    """What one side shows: files in PEM form, the key readable for its owner alone."""

    certificate: Path
    key: Path


class Authority:
    """A CA, and the certificates that it has issued, in one folder."""

    def __init__(self, folder: Path, name: str = "ca") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._ca = trustme.CA(organization_name=name)
        self._folder = folder
        self.file = folder / f"{name}.pem"
        self._ca.cert_pem.write_to_path(self.file)

    def issue(
        self, file: str, *names: str, since: datetime | None = None, until: timedelta = timedelta(days=365)
    ) -> Shown:
        """Issue a certificate for names and addresses, valid until so long from today."""
        issued = self._ca.issue_cert(*names or ("localhost",), not_before=since, not_after=datetime.now(UTC) + until)
        shown = Shown(self._folder / f"{file}.pem", self._folder / f"{file}.key")
        shown.certificate.write_bytes(b"".join(blob.bytes() for blob in issued.cert_chain_pems))
        shown.key.touch(mode=0o600)
        issued.private_key_pem.write_to_path(shown.key)
        return shown
