"""Options for HTTPS: which CA the command line trusts, and its own certificate."""

from __future__ import annotations

import ssl
from pathlib import Path
from typing import Annotated

import typer

from lift_manager.cli.common import fail

Ca = Annotated[
    Path | None,
    typer.Option(
        "--ca",
        metavar="FILE",
        help="The CA of the manager's certificate, if it is one of your own.",
        show_default=False,
    ),
]
Certificate = Annotated[
    Path | None,
    typer.Option(
        "--certificate", metavar="FILE", help="Your certificate, if the manager requires one.", show_default=False
    ),
]
CertificateKey = Annotated[
    Path | None,
    typer.Option(
        "--certificate-key",
        metavar="FILE",
        help="The private key of --certificate, if it is not in the same file.",
        show_default=False,
    ),
]


def tls_context(ca: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    """Return a context that trusts `ca`, or by default the CAs of the system; print a sentence and exit with 1 for unusable files."""
    if key is not None and certificate is None:
        raise typer.BadParameter("a key needs its certificate; give --certificate too", param_hint="--certificate-key")
    try:
        context = ssl.create_default_context(cafile=ca)
    except (OSError, ssl.SSLError) as error:
        raise fail(f"--ca {ca} cannot be used: {_why(error)}") from None
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    if certificate is None:
        return context
    try:
        # prompts for a passphrase at the terminal: a person is there to type it
        context.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise fail(f"--certificate {certificate} cannot be used: {_why(error)}") from None
    return context


def connection_advice(manager: str) -> str:
    """Return advice for a manager that does not answer."""
    text = "start it with `lift-manager serve SITE`, or give its address with --manager ADDRESS"
    if manager.startswith("https:"):
        return f"{text}; name a CA of your own with --ca FILE, and your certificate, if the manager requires one, with --certificate FILE"
    return f"{text}, which begins with https:// if its site file has `tls`"


def _why(error: OSError) -> str:
    if isinstance(error, ssl.SSLError):
        if error.reason == "KEY_VALUES_MISMATCH":
            return "its key belongs to another certificate"
        return "it is not in PEM form, or its key is not in it (--certificate-key FILE)"
    return error.strerror or str(error)
