"""The operator page, the wall view, the lobby view, and the page of error codes: files of `lift_manager/page`, which use /api/v1 and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fastapi import FastAPI
from starlette.responses import Response
from starlette.staticfiles import StaticFiles
from starlette.types import Scope

from lift_manager.web.errors_page import error_document

FOLDER = Path(__file__).parents[1] / "page"

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; media-src 'self'; connect-src 'self'; "
    "form-action 'none'; base-uri 'none'; frame-ancestors 'none'; require-trusted-types-for 'script'"
)
"""With this a browser runs no script but ours, connects to nothing but the manager, and shows the page in no frame of another."""

HEADERS = {
    "content-security-policy": POLICY,
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "referrer-policy": "no-referrer",
    "x-content-type-options": "nosniff",
    "cache-control": "no-cache",  # a new version shows at once; files are compared by their ETag
}

VIEWS = {"/": FOLDER / "index.html", "/wall": FOLDER / "wall.html", "/lobby/{lift}": FOLDER / "lobby.html"}
"""The document of each path. All links are relative, so that they also work behind a proxy that adds a prefix."""


class PageFiles(StaticFiles):
    """Scripts, styles and texts."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Return a file with the headers of the page."""
        response = await super().get_response(path, scope)
        response.headers.update(HEADERS)
        return response


def add_page(app: FastAPI, views: Mapping[str, Path] = VIEWS) -> None:
    """Serve these documents, the parts that they are made of, and the page of error codes."""
    for path, file in views.items():
        app.add_api_route(path, Document(file.read_bytes()), include_in_schema=False)
    app.add_api_route("/errors", Document(error_document().encode()), include_in_schema=False)
    app.mount("/page", PageFiles(directory=FOLDER))


class Document:
    """The endpoint of one document. Which lift a lobby view shows is read by its script."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    async def __call__(self) -> Response:
        return Response(self._content, 200, HEADERS, "text/html; charset=utf-8")
