from __future__ import annotations

import sys
from collections.abc import Sequence

from ros_world import world

from rclpy.signals import SignalHandlerOptions


def init(
    *,
    args: Sequence[str] | None = None,
    context: None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> None:
    if world.context_is_up:
        raise RuntimeError("Context.init() must only be called once")
    world.take_arguments(sys.argv if args is None else args)
    world.context_is_up = True
    world.signal_handlers = (signal_handler_options or SignalHandlerOptions.ALL).name


def ok(*, context: None = None) -> bool:
    return world.context_is_up


def shutdown(*, context: None = None, uninstall_handlers: bool | None = None) -> None:
    if not world.context_is_up:
        raise RuntimeError("Context must be initialized before it can be shutdown")
    world.context_is_up = False
    world.wake()
