# Quasiface: API, workers and an embedded database in one container; compose.yaml shows both shapes.
FROM python:3.12-slim AS build
ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1
WORKDIR /src
COPY requirements-runtime.lock requirements-build.lock ./
RUN python -m venv /opt/quasiface \
    && /opt/quasiface/bin/pip install --require-hashes -r requirements-runtime.lock
RUN python -m venv /opt/build \
    && /opt/build/bin/pip install --require-hashes -r requirements-build.lock
COPY pyproject.toml README.md LICENSE ./
COPY engine engine
COPY service service
RUN /opt/build/bin/python -m build --wheel --no-isolation --outdir /dist . \
    && /opt/quasiface/bin/pip install --no-deps /dist/*.whl

FROM python:3.12-slim
RUN useradd --uid 10001 --create-home quasiface \
    && mkdir /data /kernels && chown quasiface /data /kernels
COPY --from=build /opt/quasiface /opt/quasiface
ENV PATH=/opt/quasiface/bin:$PATH \
    NUMBA_CACHE_DIR=/kernels \
    QUASIFACE_HOST=0.0.0.0 \
    QUASIFACE_DATA_DIR=/data
USER quasiface
RUN quasiface warm
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=10s --timeout=3s --start-period=60s \
    CMD ["python", "-c", "import urllib.request as r; r.urlopen('http://127.0.0.1:8000/readyz', timeout=2)"]
STOPSIGNAL SIGTERM
ENTRYPOINT ["quasiface"]
CMD ["serve"]
