"""The service's settings: the only place that reads the environment (prefix ``QUASIFACE_``)."""

from __future__ import annotations

import ipaddress
import os
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, SecretStr, field_validator
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

MIB = 1024**2
GIB = 1024**3
_ENGINE = Path(__file__).parent.parent / "engine"


class ConfigurationError(RuntimeError):
    """Settings that the service does not start with; the message says which to change."""


class Settings(BaseSettings):
    """Every setting has a default that suits a laptop; the README explains each."""

    model_config = SettingsConfigDict(env_prefix="QUASIFACE_", extra="ignore", frozen=True)

    host: str = "127.0.0.1"
    port: int = Field(8000, ge=0, le=65535)
    data_dir: Path = Path(".quasiface")
    database_url: SecretStr | None = Field(None, description="a Postgres URL; embedded if unset")
    blob_url: str | None = Field(None, description="a folder, file:// or s3://bucket/prefix")

    api_keys: Annotated[tuple[SecretStr, ...], NoDecode] = ()
    allow_open: bool = Field(False, description="serve without keys beyond this machine")

    max_upload_bytes: int = Field(512 * MIB, gt=0)
    workers: int = Field(2, ge=1, description="worker processes of `quasiface serve`")
    queue_limit: int = Field(1000, ge=1, description="edits that may wait before 429")
    result_ttl: float = Field(7 * 24 * 3600.0, gt=0, description="seconds that results are kept")

    job_seconds: float = Field(3600.0, gt=0)
    job_memory_bytes: int = Field(4 * GIB, gt=0)
    inspect_seconds: float = Field(120.0, gt=0)
    inspect_memory_bytes: int = Field(4 * GIB, gt=0)
    cache_bytes: int = Field(4 * GIB, ge=0, description="disk for cached stages, per machine")
    open_edits: int = Field(4, ge=0, description="edits that a worker keeps open for others")
    open_bytes: int = Field(GIB, ge=0, description="memory of all that a worker keeps open")

    max_attempts: int = Field(3, ge=1, description="times an edit may lose its worker")
    stalled_seconds: float = Field(5.0, gt=0, description="silence after which a worker is lost")
    drain_seconds: float = Field(20.0, ge=0, description="time running edits get on shutdown")

    log_level: str = "INFO"
    cors_origins: Annotated[tuple[str, ...], NoDecode] = ()

    @field_validator("api_keys", "cors_origins", mode="before")
    @classmethod
    def _split_commas(cls, value: Any) -> Any:
        if isinstance(value, str):
            return tuple(part.strip() for part in value.split(",") if part.strip())
        return value

    @property
    def open(self) -> bool:
        """Whether requests need no key."""
        return not self.api_keys

    @property
    def on_loopback(self) -> bool:
        """Whether ``host`` can be reached from this machine only."""
        if self.host == "localhost":
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def blobs(self) -> str:
        """Where blobs are kept: ``blob_url``, or a folder under ``data_dir``."""
        return self.blob_url or str(self.data_dir.absolute() / "blobs")

    @property
    def scratch_dir(self) -> Path:
        """Where attempts keep files while they run."""
        return self.data_dir.absolute() / "scratch"

    @property
    def open_dir(self) -> Path:
        """Where the workers of this machine find what each other keep open."""
        return self.data_dir.absolute() / "open"

    @property
    def cache_dir(self) -> Path:
        """Where stages keep what later edits may use."""
        return self.data_dir.absolute() / "cache"

    def require_database_url(self) -> str:
        """The database's URL; ConfigurationError without one."""
        if self.database_url is None:
            raise ConfigurationError("Set QUASIFACE_DATABASE_URL to a Postgres URL.")
        return self.database_url.get_secret_value()

    def child_environment(self, database_url: str) -> dict[str, str]:
        """The environment for processes that are to work with these settings.

        What came from the environment is in there already; this adds what the command line
        decided.
        """
        return {
            **os.environ,
            "QUASIFACE_HOST": self.host,
            "QUASIFACE_PORT": str(self.port),
            "QUASIFACE_DATA_DIR": str(self.data_dir.absolute()),
            "QUASIFACE_DATABASE_URL": database_url,
        }

    def place_caches(self) -> None:
        """Say where numba keeps what it compiles, for this process and its children.

        To be called before the engine is imported: without a folder to write to, numba refuses
        to. Compiled kernels lie beside the engine's source where that can be written, else under
        ``data_dir``. ``NUMBA_CACHE_DIR`` comes first.
        """
        if not os.access(_ENGINE, os.W_OK):
            os.environ.setdefault("NUMBA_CACHE_DIR", str(self.data_dir.absolute() / "kernels"))

    def require_safe_bind(self) -> None:
        """Raise ConfigurationError rather than serve the network without keys by accident."""
        if self.open and not self.on_loopback and not self.allow_open:
            raise ConfigurationError(
                f"Refusing to listen on {self.host} without keys: set QUASIFACE_API_KEYS, or "
                "QUASIFACE_ALLOW_OPEN=1 if anyone who can reach it may use it."
            )
