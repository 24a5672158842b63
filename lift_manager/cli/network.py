"""`lift-manager network`: what the owner's network should let through, as a table or as rules."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from ipaddress import ip_address, ip_network
from typing import Annotated

import typer

from lift_manager.cli.common import SiteFile, fail, load_site_or_exit, print_lines
from lift_manager.commissioning.network import nftables, systemd
from lift_manager.commissioning.network.build import look_up, network
from lift_manager.commissioning.network.errors import UnknownHost
from lift_manager.commissioning.network.model import Network
from lift_manager.commissioning.network.summary import summary
from lift_manager.commissioning.network.suricata import rules


class Action(StrEnum):
    """What Suricata does with what a rule names."""

    ALERT = "alert"
    DROP = "drop"


Managers = Annotated[
    list[str],
    typer.Option("--manager", metavar="ADDRESS", help="Address of the manager's computer; several times for several."),
]
Clients = Annotated[
    list[str],
    typer.Option(
        "--clients", metavar="NETWORK", help="A network that may use the API, such as 10.0.0.0/24; repeatable."
    ),
]


def show(  # noqa: PLR0913 - one parameter for each option that is typed
    site: SiteFile,
    *,
    suricata: Annotated[bool, typer.Option("--suricata", help="Suricata rules; needs --manager.")] = False,
    nft: Annotated[bool, typer.Option("--nftables", help="nftables for the manager's own computer.")] = False,
    nft_gateway: Annotated[
        bool, typer.Option("--nftables-gateway", help="nftables for a gateway; needs --manager.")
    ] = False,
    unit: Annotated[bool, typer.Option("--systemd", help="A drop-in for the systemd unit.")] = False,
    manager: Managers = [],  # noqa: B006 - typer makes a new list of it
    clients: Clients = [],  # noqa: B006
    action: Annotated[Action, typer.Option(help="With --suricata: what its rules do.")] = Action.ALERT,
    reads: Annotated[
        bool, typer.Option("--reads", help="With --suricata: also reads that the manager never makes.")
    ] = False,
    user: Annotated[str, typer.Option(help="With --nftables: the user that the manager runs as.")] = "lift-manager",
) -> None:
    """Show what the owner's network should let through.

    As a table, or as rules for other programs.

    Example: lift-manager network site.yaml --nftables
    """
    if suricata + nft + nft_gateway + unit > 1:
        raise typer.BadParameter("one of --suricata, --nftables, --nftables-gateway and --systemd at a time")
    managers, networks = [_address(text) for text in manager], [_network(text) for text in clients]
    if (suricata or nft_gateway) and not managers:
        raise typer.BadParameter(
            "the address of the manager's computer, as the controllers see it", param_hint="--manager"
        )
    loaded = load_site_or_exit(site)
    try:
        found = network(loaded, look_up if suricata or nft or nft_gateway or unit else None)
    except UnknownHost as error:
        raise fail(str(error)) from error
    if suricata:
        print_lines(rules(found, managers, action=action.value, reads=reads))
    elif nft:
        print_lines(nftables.host(found, networks, _user(user)))
    else:
        print_lines(_rest(found, managers, networks, gateway=nft_gateway, unit=unit))


def _rest(
    found: Network, managers: Sequence[str], networks: Sequence[str], *, gateway: bool, unit: bool
) -> Iterator[str]:
    if gateway:
        return nftables.gateway(found, networks, managers)
    return systemd.drop_in(found, networks) if unit else summary(found)


def _address(text: str) -> str:
    try:
        return str(ip_address(text))
    except ValueError as error:
        raise typer.BadParameter(
            f"{text} is no address; write one such as 192.0.2.5", param_hint="--manager"
        ) from error


def _network(text: str) -> str:
    try:
        return str(ip_network(text))
    except ValueError as error:
        raise typer.BadParameter(f"{text}: {error}; write one such as 10.0.0.0/24", param_hint="--clients") from error


def _user(text: str) -> str:
    if not all(letter.isalnum() or letter in "-_." for letter in text) or not text:
        raise typer.BadParameter(f"{text!r} is no user; write a name or a number", param_hint="--user")
    return text
