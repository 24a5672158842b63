"""Refusals as tests look at them."""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

import pytest

from lift_manager.runtime.errors import RequestRefused

Arguments = ParamSpec("Arguments")
Reply = TypeVar("Reply")


def refusal(request: Callable[Arguments, object], *args: Arguments.args, **more: Arguments.kwargs) -> RequestRefused:
    """Make a request that is refused; return the refusal."""
    with pytest.raises(RequestRefused) as raised:
        request(*args, **more)
    return raised.value


def reply(
    request: Callable[Arguments, Reply], *args: Arguments.args, **more: Arguments.kwargs
) -> Reply | RequestRefused:
    """Make a request; return the reply, or the refusal."""
    try:
        return request(*args, **more)
    except RequestRefused as refused:
        return refused
