"""What is wrong with the certificates and keys that a site file names, and what a person should know about them."""

from __future__ import annotations

import os
import ssl
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from lift_manager.config.problem import Key, Problem
from lift_manager.config.site import SECURE_PORT, Site


@dataclass(frozen=True, slots=True)
class _TlsFiles:
    """The TLS files of one connection, as the site file names them."""

    key: Key
    owner: str
    certificate: Path
    private: Path
    ca: Path | None
    ca_key: str


def path_of(folder: Path, file: str) -> Path:
    """Return the path of a file of the site; `folder` is that of the site file."""
    return (folder / Path(file).expanduser()).resolve()


def tls_problems(site: Site, folder: Path) -> list[Problem]:
    """Return every reason why a file cannot be used."""
    if not (pairs := list(_tls_files(site, folder))):
        return []
    from lift_manager.config.certificates import certificate_problem, key_problem  # noqa: PLC0415  most sites have none

    problems: list[Problem] = []
    for pair in pairs:
        pair_problems: list[Problem] = []
        for field, path, check in (
            ("certificate", pair.certificate, certificate_problem),
            ("key", pair.private, key_problem),
            (pair.ca_key, pair.ca, certificate_problem),
        ):
            if path is not None and (problem := check(path)) is not None:
                pair_problems.append(Problem((*pair.key, field), f"{path} {problem}"))
        if not pair_problems and (problem := _pair_problem(pair)) is not None:
            pair_problems.append(Problem((*pair.key, "key"), problem))
        problems += pair_problems
    return problems


def tls_cautions(site: Site, folder: Path, now: datetime | None = None) -> Iterator[str]:
    """Yield cautions about usable files: what expires, and what other users can read."""
    now = now or datetime.now(UTC)
    for name, controller in site.controllers.items():
        if controller.tls is None and controller.port == SECURE_PORT:
            yield f"{name}: port {SECURE_PORT} is that of Modbus/TCP Security, but there is no `tls`: a controller that speaks it there hangs up"
    for pair in _tls_files(site, folder):
        from lift_manager.config.certificates import certificates_in, expiry_text  # noqa: PLC0415  as above

        for path in (pair.certificate, pair.ca):
            for certificate in () if path is None else certificates_in(path):
                if (expiry := expiry_text(certificate, now)) is not None:
                    yield f"{pair.owner}: certificate {path} {expiry}"
        if _is_world_readable(pair.private):
            yield f"{pair.owner}: everybody on this computer can read the key {pair.private}; `chmod 600` corrects it"


def tls_lines(site: Site, folder: Path) -> Iterator[str]:
    """Yield a line about each certificate of the manager."""
    for pair in _tls_files(site, folder):
        from lift_manager.config.certificates import certificates_in, role, subject_names  # noqa: PLC0415  as above

        for certificate in certificates_in(pair.certificate)[:1]:
            until = f"{certificate.not_valid_after_utc:%Y-%m-%d}"
            if pair.key[0] == "api":
                names = ", ".join(subject_names(certificate)) or "nothing"
                yield f"{pair.owner}: HTTPS, certificate for {names}, until {until}"
                continue
            if pair.key[0] == "cluster":
                yield f"{pair.owner}: etcd over TLS, certificate until {until}"
                continue
            named_role = role(certificate)
            role_text = "without a role" if named_role is None else f"as {named_role!r}"
            yield f"{pair.owner}: Modbus/TCP Security, {role_text}, certificate until {until}"


def _tls_files(site: Site, folder: Path) -> Iterator[_TlsFiles]:
    if (api := site.api.tls) is not None:
        ca = None if api.client_ca is None else path_of(folder, api.client_ca)
        own_certificate, key = path_of(folder, api.certificate), path_of(folder, api.key)
        yield _TlsFiles(("api", "tls"), "api", own_certificate, key, ca, "client_ca")
    if site.cluster is not None and (link_to_etcd := site.cluster.tls) is not None:
        own_certificate, key = path_of(folder, link_to_etcd.certificate), path_of(folder, link_to_etcd.key)
        ca = path_of(folder, link_to_etcd.ca)
        yield _TlsFiles(("cluster", "tls"), "cluster", own_certificate, key, ca, "ca")
    for name, controller in site.controllers.items():
        if (link := controller.tls) is not None:
            own_certificate, key = path_of(folder, link.certificate), path_of(folder, link.key)
            yield _TlsFiles(("controllers", name, "tls"), name, own_certificate, key, path_of(folder, link.ca), "ca")


def _pair_problem(pair: _TlsFiles) -> str | None:
    """Return why TLS refuses a certificate and a key that are each valid."""
    try:
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(pair.certificate, pair.private)
        if pair.ca is not None:
            context.load_verify_locations(pair.ca)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            return f"{pair.private} does not belong to the certificate {pair.certificate}: it is the key of another one"
        why = (error.reason or "no reason given").replace("_", " ").lower()
        return f"{pair.certificate} and {pair.private} are refused by TLS: {why}"
    return None


def _is_world_readable(path: Path) -> bool:
    try:
        return os.name == "posix" and bool(path.stat().st_mode & 0o007)
    except OSError:
        return False
