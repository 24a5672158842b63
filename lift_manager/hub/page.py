"""The operator page of a hub: sites, then the lifts of one. It uses /api/v1 and nothing else, and what the page of a site is made of."""

from __future__ import annotations

from pathlib import Path

from fastapi import FastAPI

from lift_manager.web.page import PageFiles, add_page

FOLDER = Path(__file__).with_name("page")


def add_hub_page(app: FastAPI) -> None:
    """Serve the page."""
    add_page(app, {"/": FOLDER / "index.html"})
    app.mount("/hub", PageFiles(directory=FOLDER))
