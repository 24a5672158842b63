"""What people say to a running manager: acknowledge, lock out, end a lockout."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, TypeVar
from urllib.parse import quote

import httpx
import typer
from pydantic import BaseModel

from lift_manager.api.people import AcknowledgedAnswer, LockoutAnswer, LockoutEndedAnswer
from lift_manager.cli.common import fail, say
from lift_manager.domain.service import Cause

Answer = TypeVar("Answer", bound=BaseModel)

MANAGER = "http://127.0.0.1:5003"
WITHIN_S = 5.0
"""Chosen: a manager answers from memory in milliseconds."""

LiftName = Annotated[str, typer.Argument(metavar="LIFT", help="The lift, by its name in the site file.")]
By = Annotated[str, typer.Option("--by", metavar="NAME", help="Your name; it is kept with what you say.")]
Manager = Annotated[
    str,
    typer.Option("--manager", metavar="URL", help="Where the manager runs; it takes this from its own computer only."),
]


def ack(lift: LiftName, by: By, manager: Manager = MANAGER) -> None:
    """Say that a lift was checked after a fire, or that no robot is in its car."""
    said = _post(manager, lift, "acknowledge", {"by": by}, AcknowledgedAnswer)
    causes = {Cause.FIRE: "the fire", Cause.OCCUPIED: "that no robot is in the car"}
    what = " and ".join(causes[cause] for cause in said.acknowledged)
    say([f"{said.lift}: {said.by} acknowledged {what}, {_shown(said.at)}; robots are taken again"])


def lockout(
    lift: LiftName,
    by: By,
    *,
    reason: Annotated[
        str, typer.Option("--reason", metavar="TEXT", help="Why; every robot that asks is told.", show_default=False)
    ] = "",
    end: Annotated[bool, typer.Option("--end", help="End the lockout: robots may command the lift again.")] = False,
    manager: Manager = MANAGER,
) -> None:
    """Keep robots off a lift, over restarts too, until somebody ends that with --end."""
    if end and reason:
        raise typer.BadParameter("a lockout that ends needs no reason; leave --reason out", param_hint="--reason")
    if end:
        ended = _post(manager, lift, "lockout/end", {"by": by}, LockoutEndedAnswer)
        was = ended.lockout
        say([f"{ended.lift}: the lockout by {was.by} since {_shown(was.since)} ({was.reason}) is ended by {ended.by}"])
        return
    if not reason.strip():
        raise typer.BadParameter("say why, in a few words; robots and their people are told", param_hint="--reason")
    said = _post(manager, lift, "lockout", {"by": by, "reason": reason}, LockoutAnswer)
    say([f"{said.lift}: locked out by {said.by} since {_shown(said.since)}: {said.reason}"])


def _post(manager: str, lift: str, what: str, body: dict[str, str], form: type[Answer]) -> Answer:
    url = f"{manager.rstrip('/')}/api/v1/lifts/{quote(lift, safe='')}/{what}"
    try:
        # no proxy: the manager would not take it from one
        answer = httpx.post(url, json=body, timeout=WITHIN_S, trust_env=False)
    except (httpx.TransportError, httpx.InvalidURL) as error:
        advice = "start it with `lift-manager serve SITE`, or say where it runs with --manager URL"
        raise fail(f"no manager answers at {manager} ({error}); {advice}") from error
    try:
        if answer.is_success:
            return form.model_validate_json(answer.content)
        text = str(answer.json()["detail"])
    except (ValueError, TypeError, KeyError) as error:
        text = f"what answers at {manager} is no lift manager (HTTP {answer.status_code}); say where it runs with --manager URL"
        raise fail(text) from error
    raise fail(text)


def _shown(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M}"
