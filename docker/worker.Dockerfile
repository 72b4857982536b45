ARG PYTHON_DIGEST=
# A worker: the service's kernel, the geometry and the numerical stack under it.
# docker build -f docker/worker.Dockerfile .
FROM python:3.11-slim-bookworm${PYTHON_DIGEST} AS build
RUN python -m pip install --no-cache-dir --disable-pip-version-check uv==0.13.9
WORKDIR /src
ENV UV_PROJECT_ENVIRONMENT=/opt/groundplan UV_PYTHON_DOWNLOADS=never UV_LINK_MODE=copy
COPY pyproject.toml uv.lock README.md LICENSE ./
RUN uv sync --locked --no-dev --extra worker --extra vda5050 --extra ifc --extra ocr --no-install-project --no-cache
COPY service service
COPY worker worker
COPY migrations migrations
RUN uv sync --locked --no-dev --extra worker --extra vda5050 --extra ifc --extra ocr --no-editable --no-cache --compile-bytecode
RUN uv export --quiet --locked --only-group demo --no-emit-project > demo.txt && uv pip install --no-cache --target /opt/demonstration -r demo.txt

FROM python:3.11-slim-bookworm${PYTHON_DIGEST} AS worker
RUN apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends libgl1 libegl1 libx11-6 libusb-1.0-0 libidn2-0 libgomp1 && rm -rf /var/lib/apt/lists/*
RUN useradd --uid 10001 --create-home groundplan
RUN install -d -o groundplan -g groundplan /var/lib/groundplan /var/lib/groundplan/blobs /var/cache/groundplan
COPY --from=build /opt/groundplan /opt/groundplan
ENV PATH=/opt/groundplan/bin:$PATH PYTHONUNBUFFERED=1 GROUNDPLAN_DATA_DIR=/var/lib/groundplan NUMBA_CACHE_DIR=/var/cache/groundplan

# The demonstration reads, builds and places: after it, everything that is compiled at its first use is.
FROM worker AS compiled
COPY --from=build /opt/demonstration /opt/demonstration
COPY demo /opt/demonstration/demo
WORKDIR /opt/demonstration
USER groundplan
RUN PYTHONPATH=/opt/demonstration python -m demo --no-wait --output /tmp/demonstration

FROM worker
COPY --from=compiled --chown=groundplan:groundplan /var/cache/groundplan /var/cache/groundplan
USER groundplan
WORKDIR /home/groundplan
VOLUME /var/lib/groundplan
HEALTHCHECK --interval=30s --timeout=10s --start-period=30s --retries=3 CMD ["python", "-c", "import sqlalchemy; from service.settings import Settings; sqlalchemy.create_engine(Settings().url()).connect().close()"]
CMD ["groundplan", "worker"]
