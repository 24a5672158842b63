"""What people say to a running manager: acknowledge, lock out, end a lockout, take a lift from its holder."""

from __future__ import annotations

import os
import ssl
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Annotated, TypeVar
from urllib.parse import quote

import httpx
import typer
from pydantic import BaseModel

from lift_manager.api.people import AcknowledgedAnswer, ForceReleasedAnswer, LockoutAnswer, LockoutEndedAnswer
from lift_manager.cli.common import fail, say
from lift_manager.cli.secured import Ca, Certificate, CertificateKey, advice, verified
from lift_manager.domain.keys import Secret, is_token
from lift_manager.domain.service import Cause

Answer = TypeVar("Answer", bound=BaseModel)

KEY_VARIABLE = "LIFT_MANAGER_KEY"
MANAGER = "http://127.0.0.1:5003"
WITHIN_S = 5.0
"""Chosen: a manager answers from memory in milliseconds."""

LiftName = Annotated[str, typer.Argument(metavar="LIFT", help="The lift, by its name in the site file.")]
By = Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is kept with what you say.")]
Manager = Annotated[
    str,
    typer.Option("--manager", metavar="URL", help="Where the manager runs; without a key, its own computer only."),
]
KeyFile = Annotated[
    Path | None,
    typer.Option(
        "--key-file",
        metavar="FILE",
        help=f"A file that holds your key and nothing else; or set {KEY_VARIABLE}.",
        show_default=False,
    ),
]


def ack(
    lift: LiftName,
    by: By,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Say that a lift was checked after a fire, or that no robot is in its car."""
    to = _To(manager, _key(key_file), verified(ca, certificate, certificate_key))
    said = _post(to, lift, "acknowledge", {"by": by}, AcknowledgedAnswer)
    causes = {Cause.FIRE: "the fire", Cause.OCCUPIED: "that no robot is in the car"}
    what = " and ".join(causes[cause] for cause in said.acknowledged)
    say([f"{said.lift}: {said.by} acknowledged {what}, {_shown(said.at)}; robots are taken again"])


def lockout(  # noqa: PLR0913  each is an option of the command line
    lift: LiftName,
    by: By,
    *,
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="Why; every robot that asks is told.", show_default=False)
    ] = "",
    end: Annotated[bool, typer.Option("--end", help="End the lockout: robots may command the lift again.")] = False,
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """Keep robots off a lift, over restarts too, until somebody ends that with --end."""
    if end and reason:
        raise typer.BadParameter("a lockout that ends needs no reason; leave --reason out", param_hint="--reason")
    to = _To(manager, _key(key_file), verified(ca, certificate, certificate_key))
    if end:
        ended = _post(to, lift, "lockout/end", {"by": by}, LockoutEndedAnswer)
        was = ended.lockout
        say([f"{ended.lift}: the lockout by {was.by} since {_shown(was.since)} ({was.reason}) is ended by {ended.by}"])
        return
    if not reason.strip():
        raise typer.BadParameter("say why, in a few words; robots and their people are told", param_hint="--reason")
    said = _post(to, lift, "lockout", {"by": by, "reason": reason}, LockoutAnswer)
    say([f"{said.lift}: locked out by {said.by} since {_shown(said.since)}: {said.reason}"])


def release(  # noqa: PLR0913  each is an option of the command line
    lift: LiftName,
    by: By,
    *,
    reason: Annotated[str, typer.Option("--reason", metavar="TEXT", help="Why; it is written down.")],
    manager: Manager = MANAGER,
    key_file: KeyFile = None,
    ca: Ca = None,
    certificate: Certificate = None,
    certificate_key: CertificateKey = None,
) -> None:
    """End the session of whoever holds a lift; everything is let go, and the car is not moved."""
    body = {"by": by, "reason": reason}
    to = _To(manager, _key(key_file), verified(ca, certificate, certificate_key))
    said = _post(to, lift, "session/force-release", body, ForceReleasedAnswer)
    say([f"{said.by}, {_shown(said.at)}: {said.text}"])


def _key(file: Path | None) -> Secret | None:
    """Return the key to send. Never from the command line itself: every user of the computer can read that."""
    if file is None:
        source, text = KEY_VARIABLE, os.environ.get(KEY_VARIABLE, "")
        if not text:
            return None
    else:
        source = str(file)
        try:
            text, mode = file.read_text("utf-8"), file.stat().st_mode
        except (OSError, UnicodeDecodeError) as error:
            why = error.strerror if isinstance(error, OSError) else "it is not text"
            raise fail(f"{source} cannot be read: {why}") from None
        if mode & 0o007:
            raise fail(f"every user of this computer may use the key in {source}; `chmod 600 {source}` first")
    if not is_token(text.strip()):
        raise fail(f"{source} holds no key; a key begins with lm_, and `lift-manager keys make` prints it once")
    return Secret(text.strip())


@dataclass(frozen=True, slots=True)
class _To:
    """Where a manager is, and as whom it is spoken to."""

    manager: str
    key: Secret | None
    tls: ssl.SSLContext


def _post(to: _To, lift: str, what: str, body: dict[str, str], form: type[Answer]) -> Answer:
    manager, key = to.manager, to.key
    headers = {} if key is None else {"Authorization": f"Bearer {key.reveal()}"}
    url = f"{manager.rstrip('/')}/api/v1/lifts/{quote(lift, safe='')}/{what}"
    try:
        # no proxy: the manager would not take it from one
        answer = httpx.post(url, json=body, headers=headers, timeout=WITHIN_S, trust_env=False, verify=to.tls)
    except (httpx.TransportError, httpx.InvalidURL) as error:
        raise fail(f"no manager answers at {manager} ({error}); {advice(manager)}") from error
    try:
        if answer.is_success:
            return form.model_validate_json(answer.content)
        text = str(answer.json()["detail"])
    except (ValueError, TypeError, KeyError) as error:
        text = f"what answers at {manager} is no lift manager (HTTP {answer.status_code}); say where it runs with --manager URL"
        raise fail(text) from error
    if answer.status_code == httpx.codes.UNAUTHORIZED:
        text = f"{text}; here, with --key-file FILE or in the variable {KEY_VARIABLE}"
    raise fail(text)


def _shown(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M}"
