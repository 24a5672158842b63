"""Every error that the web face raises on purpose.

WebError
├── ListenError     the address cannot be listened on; the message says what to do
└── RequestError    a request is not carried out; `answers.answer` makes the answer of the face that was addressed
"""

from __future__ import annotations

from collections.abc import Mapping

from lift_manager.lift.refusals import Blocking
from lift_manager.web.error_codes import CODES


class WebError(Exception):
    """Root of everything that the web face raises on purpose."""


class ListenError(WebError):
    """The address cannot be listened on; the message says what to do."""


class RequestError(WebError):
    """Why a request is not carried out, with a code of `codes.CODES`."""

    def __init__(
        self,
        code: str,
        message: str,
        *,
        field: str | None = None,
        blocking: Blocking | None = None,
        headers: Mapping[str, str] | None = None,
        status: int | None = None,
    ) -> None:
        """`field` is the key of the body, or of the query, that is wrong; `status` replaces the one that goes with the code."""
        super().__init__(message)
        self.code = code
        """Stable, for programs; only /api/v1 has a place for it."""
        self.message = message
        self.field = field
        self.blocking = blocking
        self.headers = headers
        self.status = CODES[code].status if status is None else status
