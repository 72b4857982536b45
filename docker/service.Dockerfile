ARG PYTHON_DIGEST=
# The HTTP service, the migrations and the key command: without the numerical stack of the worker.
# docker build -f docker/service.Dockerfile .
FROM python:3.11-slim-bookworm${PYTHON_DIGEST} AS build
RUN python -m pip install --no-cache-dir --disable-pip-version-check uv==0.13.9
WORKDIR /src
ENV UV_PROJECT_ENVIRONMENT=/opt/groundplan UV_PYTHON_DOWNLOADS=never UV_LINK_MODE=copy
COPY pyproject.toml uv.lock README.md LICENSE ./
RUN uv sync --locked --no-dev --no-install-project --no-cache
COPY service service
COPY worker worker
COPY migrations migrations
RUN uv sync --locked --no-dev --no-editable --no-cache --compile-bytecode

FROM python:3.11-slim-bookworm${PYTHON_DIGEST}
RUN useradd --uid 10001 --create-home groundplan
RUN install -d -o groundplan -g groundplan /var/lib/groundplan /var/lib/groundplan/blobs /run/groundplan
COPY --from=build /opt/groundplan /opt/groundplan
ENV PATH=/opt/groundplan/bin:$PATH PYTHONUNBUFFERED=1 GROUNDPLAN_DATA_DIR=/var/lib/groundplan GROUNDPLAN_HOST=0.0.0.0 GROUNDPLAN_PORT=8000
USER groundplan
WORKDIR /home/groundplan
VOLUME /var/lib/groundplan
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=5s --start-period=30s --retries=3 CMD ["python", "-c", "import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/readyz', timeout=4)"]
CMD ["groundplan", "serve"]
