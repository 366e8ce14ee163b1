"""The HTTP application: wiring and nothing else."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from importlib.resources import files
from threading import Event

from asgi_correlation_id import CorrelationIdMiddleware
from fastapi import FastAPI
from fastapi.staticfiles import StaticFiles
from starlette.middleware.cors import CORSMiddleware

from service import openapi, problem_responses
from service.access import Access
from service.dependencies import JobNames, Service
from service.metrics import Metrics
from service.middleware import BodyDrain, RequestLog, SecurityHeaders
from service.routes import router
from service.routes.operations import ASSETS
from service.runner import Runner
from service.settings import Settings
from service.stores.blobs import Blobs
from service.stores.records import Records

EXPOSED = ["ETag", "Location", "Retry-After", "Content-Range", "X-Request-ID"]


def create_app(
    settings: Settings,
    records: Records,
    blobs: Blobs,
    runner: Runner,
    *,
    jobs: JobNames | None = None,
    draining: Event | None = None,
) -> FastAPI:
    """The application around these parts, which the caller made and closes.

    While ``draining`` is set, new work is refused, and those who wait are answered.
    """
    service = Service(
        settings=settings,
        records=records,
        blobs=blobs,
        runner=runner,
        jobs=jobs or JobNames(),
        draining=draining or Event(),
        access=Access(key.get_secret_value() for key in settings.api_keys),
        metrics=Metrics(),
    )

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncGenerator[None]:
        yield
        service.draining.set()

    app = FastAPI(title="Quasiface", lifespan=lifespan, docs_url=None, redoc_url=None)
    app.openapi = openapi.document
    app.state.service = service
    app.include_router(router)
    assets = StaticFiles(directory=str(files("fastapi_offline") / "static"))
    app.mount(ASSETS, assets, name="docs-assets")
    problem_responses.install(app)
    app.add_middleware(
        CORSMiddleware,
        allow_origins=settings.cors_origins,
        allow_methods=["*"],
        allow_headers=["*"],
        expose_headers=EXPOSED,
    )
    app.add_middleware(SecurityHeaders)
    app.add_middleware(RequestLog, metrics=service.metrics)
    app.add_middleware(CorrelationIdMiddleware)
    app.add_middleware(BodyDrain)
    return app
