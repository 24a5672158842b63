"""uvicorn's HTTP protocol, answering in JSON even to what it cannot read."""

from __future__ import annotations

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from lift_manager.web.envelope import failed

ADVICE = (
    "this could not be read as HTTP/1.1; write what is not ASCII in the address percent-encoded"
    " (curl: -G --data-urlencode 'lift_name=...') and let Content-Length be the length of the body"
)


class JsonHttpProtocol(HttpToolsProtocol):
    """The workshop's clients parse every answer as JSON, and a plain line would end them."""

    def send_400_response(self, msg: str) -> None:
        """Answer with the envelope where uvicorn would answer with the line `msg`, and hang up."""
        answer = failed(ADVICE, status=400)
        headers = [*answer.raw_headers, (b"connection", b"close")]
        lines = [b"HTTP/1.1 400 Bad Request", *(name + b": " + value for name, value in headers)]
        self.transport.write(b"\r\n".join([*lines, b"", bytes(answer.body)]))
        self.transport.close()
