# A worker: the service's kernel, the geometry and the numerical stack under it.
# docker build -f docker/worker.Dockerfile .
FROM python:3.11-slim-bookworm AS build
RUN python -m pip install --no-cache-dir --disable-pip-version-check uv==0.13.9
WORKDIR /src
ENV UV_PROJECT_ENVIRONMENT=/opt/groundplan UV_PYTHON_DOWNLOADS=never UV_LINK_MODE=copy
COPY pyproject.toml uv.lock README.md LICENSE ./
RUN uv sync --locked --no-dev --extra worker --extra vda5050 --extra ifc --extra ocr --no-install-project --no-cache
COPY service service
COPY worker worker
COPY migrations migrations
RUN uv sync --locked --no-dev --extra worker --extra vda5050 --extra ifc --extra ocr --no-editable --no-cache --compile-bytecode

FROM python:3.11-slim-bookworm
RUN apt-get -qq update && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends libgl1 libegl1 libx11-6 libusb-1.0-0 libidn2-0 libgomp1 && rm -rf /var/lib/apt/lists/*
RUN useradd --uid 10001 --create-home groundplan
RUN install -d -o groundplan -g groundplan /var/lib/groundplan
COPY --from=build /opt/groundplan /opt/groundplan
ENV PATH=/opt/groundplan/bin:$PATH PYTHONUNBUFFERED=1 GROUNDPLAN_DATA_DIR=/var/lib/groundplan
USER groundplan
WORKDIR /home/groundplan
VOLUME /var/lib/groundplan
HEALTHCHECK --interval=30s --timeout=10s --start-period=30s --retries=3 CMD ["python", "-c", "import os, sqlalchemy; sqlalchemy.create_engine(os.environ['GROUNDPLAN_DATABASE_URL']).connect().close()"]
CMD ["groundplan", "worker"]
