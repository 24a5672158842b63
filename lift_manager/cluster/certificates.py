"""The certificate with which a manager talks to etcd over TLS, renewed while it runs."""

from __future__ import annotations

import logging
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from lift_manager.cluster.errors import ClusterError, ClusterUnusable, EtcdError, EtcdUnavailable
from lift_manager.cluster.etcd import Etcd, read
from lift_manager.plain.file_stamp import FileStamp, file_stamp

_log = logging.getLogger(__name__)

ANSWER_S = 2.0
"""How long a member may take to accept renewed files. Chosen: nothing waits for it."""


@dataclass(frozen=True, slots=True)
class TlsFiles:
    """Files in PEM form."""

    ca: Path
    """Of the members."""
    certificate: Path
    key: Path


class EtcdCertificates:
    """The TLS settings for connections to etcd, as of the last files that a member has accepted."""

    def __init__(self, members: Sequence[str], files: TlsFiles) -> None:
        """Read the files. Raises ClusterUnusable."""
        self._members = members
        self._files = files
        self._stamp = self._stamp_now()
        self._latest = _load(files)
        self._trouble = ""

    def latest(self) -> ssl.SSLContext:
        """Return the settings of the next connection. Does not access files."""
        return self._latest

    def renew(self) -> None:
        """Use the files from now on if they have changed. Blocks as long as the disk and etcd do.

        They are tried first: a certificate that no member accepts would cost the term, and the connections of the previous one last.
        """
        stamp = self._stamp_now()
        if stamp == self._stamp:
            return
        try:
            context = _load(self._files)
            self._try(context)
        except ClusterError as error:
            if str(error) != self._trouble:
                _log.warning(
                    "cluster: the renewed certificate cannot be used, and the previous one stays in use: %s", error
                )
            self._trouble = str(error)
            return
        self._latest, self._stamp, self._trouble = context, stamp, ""
        _log.info("cluster: certificate %s was renewed, and is used from now on", self._files.certificate)

    def _stamp_now(self) -> FileStamp:
        return file_stamp((self._files.ca, self._files.certificate, self._files.key))

    def _try(self, context: ssl.SSLContext) -> None:
        """Return once a member has answered. Raises EtcdUnavailable if none does."""
        refusals: list[str] = []
        for member in self._members:
            etcd = Etcd([member], tls=lambda: context, timeout_s=ANSWER_S)
            try:
                etcd.transact([], [read("/lift-manager/")])
            except EtcdError as error:
                refusals.append(str(error))
            else:
                return
            finally:
                etcd.close()
        raise EtcdUnavailable("; ".join(refusals))


def _load(files: TlsFiles) -> ssl.SSLContext:
    # always a new context: loading into the one in use would leave it with a certificate that does not match its key
    try:
        context = ssl.create_default_context(cafile=files.ca)
        context.load_cert_chain(files.certificate, files.key, password=_no_passphrase)
    except (OSError, ValueError) as error:
        raise ClusterUnusable(f"the files of `cluster: tls` cannot be used ({error})") from error
    return context


def _no_passphrase() -> str:
    # without this OpenSSL would prompt at the terminal, and the manager would hang
    raise ValueError("the key is protected by a passphrase; store it without one, readable for the manager alone")
