"""The operator page of a hub: sites, then the lifts of one. It uses /api/v1 and nothing else, and what the page of a site is made of."""

from __future__ import annotations

from pathlib import Path

from fastapi import FastAPI

from lift_manager.web.errors_page import error_document
from lift_manager.web.page import FOLDER as SITE_PAGE
from lift_manager.web.page import Document, PageFiles

FOLDER = Path(__file__).with_name("page")


def add_page(app: FastAPI) -> None:
    """Serve the page."""
    app.add_api_route("/", Document((FOLDER / "index.html").read_bytes()), include_in_schema=False)
    app.add_api_route("/errors", Document(error_document().encode()), include_in_schema=False)
    app.mount("/hub", PageFiles(directory=FOLDER))
    app.mount("/page", PageFiles(directory=SITE_PAGE))
