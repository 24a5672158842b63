"""/docs and /redoc for a lift lobby without internet."""

from __future__ import annotations

from fastapi import FastAPI
from fastapi.openapi.docs import get_redoc_html, get_swagger_ui_html
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

# With this a browser connects to nothing but the manager, whatever a later version of the two scripts would load.
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; worker-src blob:; frame-ancestors 'none'; base-uri 'none'"
)
NO_ICON = "data:,"
ASSETS = "fastapi_standalone_docs"

SWAGGER = {
    "validatorUrl": None,  # would send the schema to the internet and show a badge
    "tryItOutEnabled": True,
    "defaultModelsExpandDepth": -1,
}


def add_docs(app: FastAPI) -> None:
    """Serve both pages, and their scripts from the package fastapi-standalone-docs.

    Its `StandaloneDocs` is not used: it replaces functions of FastAPI for every application in the process. All links
    are relative, so that the pages also work behind a proxy that adds a prefix.
    """

    async def docs() -> Response:
        page = get_swagger_ui_html(
            openapi_url="openapi.json",
            title=f"{app.title}: docs",
            swagger_js_url="docs/swagger-ui-bundle.js",
            swagger_css_url="docs/swagger-ui.css",
            swagger_favicon_url=NO_ICON,
            swagger_ui_parameters=SWAGGER,
        )
        return _guarded(page)

    async def redoc() -> Response:
        page = get_redoc_html(
            openapi_url="openapi.json",
            title=f"{app.title}: reference",
            redoc_js_url="redoc/redoc.standalone.js",
            redoc_favicon_url=NO_ICON,
            with_google_fonts=False,
        )
        return _guarded(page)

    app.add_api_route("/docs", docs, include_in_schema=False)
    app.mount("/docs", StaticFiles(packages=[(ASSETS, "static/swagger")]))
    app.add_api_route("/redoc", redoc, include_in_schema=False)
    # the package makes the script look for its logo beside the page
    app.mount("/redoc", StaticFiles(packages=[(ASSETS, "static/redoc")]))


def _guarded(page: Response) -> Response:
    page.headers["content-security-policy"] = POLICY
    return page
