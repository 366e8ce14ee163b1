"""For those who run the service: health, version, metrics, documentation."""

from __future__ import annotations

import base64
import hashlib
import re
from importlib.metadata import version as installed_version

from fastapi import APIRouter, Depends, Request, Response
from fastapi.openapi.docs import get_swagger_ui_html
from prometheus_client import CONTENT_TYPE_LATEST

from service.dependencies import TheService, require_key
from service.errors import DrainingError
from service.routes.documents import problems
from service.schemas import Ready, Version

router = APIRouter(tags=["operations"])
ASSETS = "/docs/assets"


@router.get("/livez", operation_id="livez")
def livez() -> Ready:
    """The process answers."""
    return Ready(status="live")


@router.get("/readyz", operation_id="readyz", responses=problems(503))
def readyz(service: TheService) -> Ready:
    """The database answers and the process takes new work."""
    if service.draining.is_set():
        raise DrainingError("The service is shutting down")
    service.records.ping()
    return Ready(status="ready")


@router.get("/version", operation_id="version")
def version() -> Version:
    """Which service this is."""
    return Version(name="quasiface", version=installed_version("quasiface"), api="v1")


@router.get(
    "/metrics",
    operation_id="metrics",
    response_class=Response,
    dependencies=[Depends(require_key)],
    responses={200: {"description": "For Prometheus", "content": {"text/plain": {}}}}
    | problems(401, 403),
)
def metrics(service: TheService) -> Response:
    """Requests and edits, counted."""
    exposition = service.metrics.exposition(service.records.queue_counts())
    return Response(exposition, media_type=CONTENT_TYPE_LATEST)


@router.get("/docs", include_in_schema=False)
def docs(request: Request) -> Response:
    """The OpenAPI document, to read and to try; all of the page comes from this service."""
    root = request.scope.get("root_path", "")
    page = get_swagger_ui_html(
        openapi_url=f"{root}/openapi.json",
        title="Quasiface",
        swagger_js_url=f"{root}{ASSETS}/swagger-ui-bundle.js",
        swagger_css_url=f"{root}{ASSETS}/swagger-ui.css",
        swagger_favicon_url=f"{root}{ASSETS}/favicon.png",
    )
    scripts = re.findall(rb"<script>(.*?)</script>", bytes(page.body), re.DOTALL)
    hashes = " ".join(f"'sha256-{_base64_sha256(script)}'" for script in scripts)
    page.headers["Content-Security-Policy"] = (
        f"default-src 'self'; script-src 'self' {hashes}; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data:; frame-ancestors 'none'"
    )
    return page


def _base64_sha256(data: bytes) -> str:
    return base64.b64encode(hashlib.sha256(data).digest()).decode()
