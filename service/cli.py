"""The command line: ``quasiface serve | api | worker | demo | warm | openapi``.

Each command imports what it needs when it runs, so that none waits for what it does not use.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import asyncio
import socket
from pathlib import Path
from typing import Annotated, Any

import structlog
import typer
from pydantic import ValidationError

from service import logs
from service.processes import end_quickly
from service.settings import ConfigurationError, Settings

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Edit 3D face models by quasi-conformal maps. Settings: QUASIFACE_… variables.",
    pretty_exceptions_enable=False,
)
_log = structlog.stdlib.get_logger("service")

Host = Annotated[str | None, typer.Option(help="Address to listen on (127.0.0.1).")]
Port = Annotated[int | None, typer.Option(help="Port to listen on (8000); 0 for any.")]
DataDir = Annotated[Path | None, typer.Option(help="Folder for all that is kept (.quasiface).")]
Listener = Annotated[int | None, typer.Option(hidden=True)]


@app.command()
def serve(host: Host = None, port: Port = None, data_dir: DataDir = None) -> None:
    """Run everything on this machine: database, API and workers."""
    from service.embedded import EmbeddedPostgresError
    from service.supervisor import Supervisor

    settings = _settings(host=host, port=port, data_dir=data_dir)
    _check_bind(settings)
    try:
        Supervisor(settings).run()
    except (EmbeddedPostgresError, OSError) as error:
        raise _refusal(str(error)) from error


@app.command()
def api(
    host: Host = None, port: Port = None, data_dir: DataDir = None, listener: Listener = None
) -> None:
    """Run the HTTP half alone, against QUASIFACE_DATABASE_URL and QUASIFACE_BLOB_URL."""
    settings = _settings(host=host, port=port, data_dir=data_dir)
    from service.api_process import run_api

    if listener is None:
        _check_bind(settings)
    try:
        run_api(settings, None if listener is None else socket.socket(fileno=listener))
    except ConfigurationError as error:
        raise _refusal(str(error)) from error


@app.command()
def worker(data_dir: DataDir = None) -> None:
    """Run one worker alone, against QUASIFACE_DATABASE_URL and QUASIFACE_BLOB_URL."""
    settings = _settings(data_dir=data_dir)
    from service.worker_process import run_worker

    try:
        asyncio.run(run_worker(settings))
    except ConfigurationError as error:
        raise _refusal(str(error)) from error


@app.command()
def warm(data_dir: DataDir = None) -> None:
    """Compile all kernels now, so that no edit has to wait for that later."""
    _settings(data_dir=data_dir)
    from service.warm import warm as compile_all

    compile_all(typer.echo)


@app.command()
def openapi(
    check: Annotated[
        Path | None, typer.Option(help="Fail unless this file holds the current document.")
    ] = None,
    write: Annotated[Path | None, typer.Option(help="Write the current document here.")] = None,
) -> None:
    """Print, write or check the OpenAPI document."""
    from service.openapi import command

    command(check, write)


@app.command()
def demo(
    document: Annotated[Path, typer.Argument(help="An edit document that names mesh files.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")] = Path("demo-out"),
) -> None:
    """Start the service, run one edit through its HTTP API, download the results, stop."""
    from service.demo import DemoError, run_demo

    try:
        run_demo(document, out)
    except DemoError as error:
        raise _refusal(str(error)) from error


def _settings(**given: Any) -> Settings:
    chosen = {name: value for name, value in given.items() if value is not None}
    try:
        settings = Settings(**chosen)
    except ValidationError as error:
        wrong = "; ".join(
            f"QUASIFACE_{str(fault['loc'][0]).upper()}: {fault['msg']}"
            for fault in error.errors(include_input=False, include_url=False)
        )
        raise _refusal(wrong) from None
    logs.configure(settings.log_level)
    settings.place_caches()  # before anything imports the engine
    return settings


def _check_bind(settings: Settings) -> None:
    try:
        settings.require_safe_bind()
    except ConfigurationError as error:
        raise _refusal(str(error)) from error
    if settings.open:
        _log.warning(
            "OPEN: no QUASIFACE_API_KEYS are set; whoever reaches this address may use the service",
            host=settings.host,
        )


def _refusal(message: str) -> typer.Exit:
    typer.echo(f"quasiface: {message}", err=True)
    return typer.Exit(2)


def main() -> None:
    """The entry point."""
    end_quickly()
    app()


if __name__ == "__main__":
    main()
