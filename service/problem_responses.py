"""Exceptions to HTTP responses: problem details, whatever went wrong."""

from __future__ import annotations

from collections.abc import Mapping
from http import HTTPStatus

from asgi_correlation_id import correlation_id
from fastapi import FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.routing import Match

from service.errors import KINDS, URN, InvalidError, MalformedError, headers_of, problem_of
from service.schemas import Problem, ProblemError
from service.schemas.parsing import code, limits

MEDIA_TYPE = "application/problem+json"
_METHODS = ("GET", "HEAD", "POST", "PUT", "DELETE")


def install(app: FastAPI) -> None:
    """Answer every exception with problem details."""
    for kind in KINDS:
        app.add_exception_handler(kind, _known)
    app.add_exception_handler(RequestValidationError, _parameters)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(ClientDisconnect, _disconnected)
    app.add_exception_handler(Exception, _unforeseen)


def response(problem: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """Problem details as an HTTP response."""
    return Response(
        problem.model_dump_json(),
        status_code=problem.status,
        headers=dict(headers or {}),
        media_type=MEDIA_TYPE,
    )


async def _known(_request: Request, error: Exception) -> Response:
    return response(problem_of(error), headers_of(error))


async def _parameters(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    errors = [
        ProblemError(
            parameter=str(item["loc"][-1]),
            code=code(item),
            message=item["msg"],
            elements=limits(item),
        )
        for item in error.errors()
    ]
    detail = "; ".join(f"{item.parameter}: {item.message}" for item in errors)
    return await _known(request, InvalidError(detail, errors=errors))


async def _http(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    status = HTTPStatus(error.status_code)
    headers = dict(error.headers or {})
    if status == HTTPStatus.METHOD_NOT_ALLOWED:
        headers["Allow"] = ", ".join(_methods(request))
    detail = error.detail or status.description
    return response(
        Problem(
            type=URN + status.phrase.lower().replace(" ", "-"),
            title=status.phrase,
            status=status,
            detail=detail,
            errors=[ProblemError(code=status.name.lower(), message=detail)],
            trace_id=correlation_id.get(),
        ),
        headers,
    )


def _methods(request: Request) -> list[str]:
    """The methods that the request's path takes, on all of its routes together."""
    app: FastAPI = request.app

    def taken(method: str) -> bool:
        scope = {**request.scope, "method": method}
        return any(route.matches(scope)[0] == Match.FULL for route in app.routes)

    return [method for method in _METHODS if taken(method)]


async def _disconnected(request: Request, _error: Exception) -> Response:
    return await _known(request, MalformedError("The connection ended before the body did"))


async def _unforeseen(_request: Request, _error: Exception) -> Response:
    """Says no more than the trace id; the server logs the exception itself under it."""
    trace_id = correlation_id.get()
    return response(
        Problem(
            type=f"{URN}unforeseen",
            title="The service made a mistake",
            status=500,
            detail="This is a fault of the service. Its log says more under the trace id.",
            trace_id=trace_id,
        ),
        {"X-Request-ID": trace_id} if trace_id else None,
    )
