"""The process's settings, from the environment: read by the composition roots alone."""

from __future__ import annotations

from pathlib import Path
from typing import Self

from pydantic import Field, SecretStr, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict
from sqlalchemy import make_url

from service.domain.outbound import Network, parse_networks

MIB = 1024 * 1024


class Settings(BaseSettings):
    """Hold what an operator can set; each name is an environment variable with the prefix GROUNDPLAN_."""

    model_config = SettingsConfigDict(env_prefix="GROUNDPLAN_", extra="ignore", hide_input_in_errors=True)

    data_dir: Path = Field(
        Path("groundplan-data"), description="Folder of uploads, artifacts and (by default) the database."
    )
    database_url: SecretStr | None = Field(
        None,
        description="SQLAlchemy URL (`postgresql+psycopg://...`); by default SQLite in the data folder.",
    )
    database_password_file: Path | None = Field(
        None, description="File with the database's password, where the URL has none."
    )
    host: str = Field("127.0.0.1", description="Address on which the service listens.")
    port: int = Field(
        8000, ge=0, le=65535, description="Port on which the service listens; 0 takes a free one."
    )
    public_url: str | None = Field(
        None, description="Address under which clients reach the service, for links in answers."
    )
    trusted_hosts: str | None = Field(
        None,
        description="Names, comma-separated, that links in answers may have beside this machine's own, where"
        " no public URL is set: what else a request's `Host` says is not believed.",
    )
    front_networks: str | None = Field(
        None,
        description="Addresses or networks, comma-separated, of fronts whose `X-Forwarded-For` and"
        " `X-Forwarded-Proto` are believed; by default nobody's are.",
    )

    tls_cert: Path | None = Field(
        None,
        description="PEM file of the certificate (chain) with which the service speaks HTTPS; needs the key.",
    )
    tls_key: Path | None = Field(None, description="PEM file of the certificate's private key.")

    metrics_host: str = Field("127.0.0.1", description="Address on which metrics have a port of their own.")
    metrics_port: int | None = Field(
        None,
        ge=0,
        le=65535,
        description="Port on which the service gives its metrics besides; by default none.",
    )
    worker_metrics_port: int | None = Field(
        None, ge=0, le=65535, description="Port on which the worker gives its metrics; by default none."
    )

    hsts_s: int = Field(
        31_536_000,
        ge=0,
        description="Seconds for which browsers come back by HTTPS alone (HSTS), told where this is how the"
        " service is reached; 0 does not tell.",
    )

    front_prefix: str | None = Field(
        None,
        pattern=r"^/([A-Za-z0-9_-]+/)+$",
        description="Where a front (nginx) has the folder `blobs` as an internal location: it is told which"
        " file to send (X-Accel-Redirect). Only where no client reaches the service past the front.",
    )

    max_upload_bytes: int = Field(2048 * MIB, gt=0, description="Largest file that is taken.")
    max_pixels: int = Field(200_000_000, gt=0, description="Largest image that is read.")
    max_points: int = Field(50_000_000, gt=0, description="Largest point cloud that is read.")
    reserve_bytes: int | None = Field(
        None,
        ge=0,
        description="Bytes that stay free on the disks of the data folder and of SQLite: with less, uploads"
        " and jobs are refused or wait, and downloads go on. By default 1 GiB or 5 % of the disk, the"
        " lesser.",
    )
    upload_expiry_s: float = Field(
        24 * 3600.0, gt=0, description="Seconds until an unfinished upload in pieces is dropped."
    )
    idempotency_expiry_s: float = Field(
        24 * 3600.0, gt=0, description="Seconds for which an Idempotency-Key is remembered."
    )

    max_requests_per_key_per_minute: int = Field(
        12_000, gt=0, description="How many requests one key may send in a minute to one service process."
    )
    max_streams_per_key: int = Field(
        1_000, gt=0, description="How many event streams one key may have open at one service process."
    )

    keep_revisions: int = Field(
        0,
        ge=0,
        description="How many ready revisions of a map keep their files, beside those that a channel or a "
        "robot needs; 0 keeps all. What they are made of is always kept.",
    )
    webhook_networks: str | None = Field(
        None,
        description="Networks, comma-separated, that webhooks may lie in although they are not public:"
        " `10.0.0.0/8,fd00::/8`.",
    )

    mqtt_url: SecretStr | None = Field(
        None, description="MQTT broker of `groundplan vda5050`: `mqtt[s]://[user:password@]host[:port]`."
    )
    mqtt_interface: str = Field(
        "uagv", pattern=r"^[^+#]+$", description="First level of the topics of VDA 5050: the interface name."
    )

    lease_s: float = Field(
        8.0, gt=0, description="Seconds after its last beat until a worker counts as lost."
    )
    beat_s: float = Field(2.0, gt=0, description="Seconds between two beats of a worker.")
    poll_s: float = Field(0.05, gt=0, description="Seconds between two looks at the queue (SQLite).")
    room_wait_s: float = Field(
        15.0,
        gt=0,
        description="Least seconds until a job that found the disk full is tried again; twice as long as"
        " the try took where that is more.",
    )
    job_memory_bytes: int | None = Field(
        None,
        gt=0,
        description="Memory that one job may take. By default 10 GiB or 80 % of what the machine, or the"
        " container, has, the lesser.",
    )
    job_cpu_s: float = Field(1800.0, gt=0, description="CPU seconds that one job may take.")
    reading_cpu_s: float = Field(
        60.0,
        gt=0,
        description="CPU seconds that reading an upload may take; 10 s are added for each further million"
        " points, 10 Mpx or 10 MB of CAD that it promises, up to what one job may take.",
    )
    reading_memory_bytes: int = Field(
        2048 * MIB,
        gt=0,
        description="Memory that reading an upload may take, or what its points and pixels need, up to what"
        " one job may take.",
    )
    job_wall_s: float = Field(1800.0, gt=0, description="Seconds that one job may take.")

    log_level: str = Field("info", description="debug, info, warning or error.")
    crash_at: str | None = Field(
        None, description="For tests: the crash point at which it kills itself: `name`, `name:n`, `@file`."
    )

    @field_validator("webhook_networks", "front_networks")
    @classmethod
    def _are_networks(cls, value: str | None) -> str | None:
        parse_networks(value or "")
        return value

    @model_validator(mode="after")
    def _has_both_parts_of_tls(self) -> Self:
        if (self.tls_cert is None) != (self.tls_key is None):
            msg = "a certificate and its key belong together: give GROUNDPLAN_TLS_CERT and GROUNDPLAN_TLS_KEY"
            raise ValueError(msg)
        return self

    def hosts(self) -> list[str]:
        """Return the names that a request's `Host` may have beside this machine's own."""
        return [name.strip() for name in (self.trusted_hosts or "").split(",") if name.strip()]

    def fronts(self) -> list[str]:
        """Return the networks of fronts whose forwarded headers are believed."""
        return [str(network) for network in parse_networks(self.front_networks or "")]

    def is_reached_by_https(self) -> bool:
        """Return whether clients reach the service by HTTPS: by its own certificate, or a front's."""
        return self.tls_cert is not None or (self.public_url or "").startswith("https:")

    def networks(self) -> tuple[Network, ...]:
        """Return the networks that webhooks may lie in although they are not public."""
        return parse_networks(self.webhook_networks or "")

    def folders(self) -> dict[str, Path]:
        """Return the folders that this installation writes to, by what lies there."""
        found = {
            "data": self.data_dir,
            "uploads": self.data_dir / "uploads",
            "blobs": self.data_dir / "blobs",
        }
        url = make_url(self.url())
        if url.get_backend_name() == "sqlite" and url.database:
            found["database"] = Path(url.database).parent
        return found

    def shown_url(self) -> str:
        """Return the database's URL for people, without its password."""
        return make_url(self.url()).render_as_string(hide_password=True)

    def url(self) -> str:
        """Return the database's SQLAlchemy URL, with the password of its file."""
        if self.database_url is not None:
            url = self.database_url.get_secret_value()
            if self.database_password_file is None:
                return url
            password = self.database_password_file.read_text(encoding="utf-8").strip()
            return make_url(url).set(password=password).render_as_string(hide_password=False)
        return f"sqlite:///{(self.data_dir / 'groundplan.sqlite3').absolute()}"
