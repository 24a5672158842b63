"""The recorded announcements of the lobby view: a list, and the files in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from fastapi import FastAPI, Request
from starlette.responses import FileResponse, JSONResponse, Response

from lift_manager.config.announcements import MEDIA_TYPES
from lift_manager.web.errors import RequestError
from lift_manager.web.page import HEADERS


def add_announcements(app: FastAPI, files: Mapping[str, Path]) -> None:
    """Serve these files, by moment, and no other of their folder."""
    by_name = {file.name: file for file in files.values()}
    listed = {moment: f"announcements/{file.name}" for moment, file in files.items()}

    async def announcements() -> Response:
        return JSONResponse(listed, headers=HEADERS)

    async def announcement(request: Request) -> Response:
        file = by_name.get(request.path_params["file"])
        if file is None or not file.is_file():
            raise RequestError("no_such_path", "there is no such announcement")
        return FileResponse(file, headers=HEADERS, media_type=MEDIA_TYPES[file.suffix])

    app.add_api_route("/announcements", announcements, include_in_schema=False)
    app.add_api_route("/announcements/{file}", announcement, include_in_schema=False)
