"""Every error the web face raises on purpose.

WebError
    ListenError         the address cannot be listened on; the message says what to do
    InputError          the caller sent something that cannot be used; the message names what can
        BodyTooLongError    its body is longer than `body.LIMIT_BYTES`
"""

from __future__ import annotations


class WebError(Exception):
    """Root of everything that the web face raises on purpose."""


class ListenError(WebError):
    """The address cannot be listened on; the message says what to do."""


class InputError(WebError):
    """The caller sent something that cannot be used; the message names what can."""


class BodyTooLongError(InputError):
    """The body is longer than anything this face could want; most of it was never read."""
