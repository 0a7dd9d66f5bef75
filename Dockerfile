# imuscope in a container: built with nothing but Python, run without root, without a home, with a read-only root.
# The same file builds for x86-64 and, on such a machine or by emulation, for 64-bit ARM: --platform linux/arm64.
#
#   docker build -t imuscope --build-arg COMMIT="$(git rev-parse --short=8 HEAD)" .
#   docker run --rm --read-only --tmpfs /tmp -v imuscope:/data --hostname "$(hostname)" -p 8080:8080 \
#       --device /dev/ttyUSB0 --group-add "$(stat -c %g /dev/ttyUSB0)" imuscope /dev/ttyUSB0
#
# --device       hands the serial port in; --group-add gives the group that owns it (dialout), since nobody here is root.
# a port that comes and goes: -v /dev:/dev --device-cgroup-rule 'c 188:* rmw' (188: USB serial, 166: ttyACM) instead.
# UDP and TCP    sources that the robot sends to need their port too: -p 5005:5005/udp, or --network host.
# --hostname     the machine's own name: the address that is printed uses it, and requests to it are let in.
# The address is not loopback, so a token is asked for: it is in the URL that `docker logs` shows.
# /data          recordings; without a volume there they end with the container.
# /tmp           for a while, while a file is uploaded, exported or opened.

# Versions are named in full, so that two builds of one commit are of the same parts; raise them when Python does.
FROM python:3.13.12-slim-bookworm AS build
ENV UV_COMPILE_BYTECODE=1 UV_LINK_MODE=copy UV_PYTHON_DOWNLOADS=never UV_PROJECT_ENVIRONMENT=/app \
    PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_ROOT_USER_ACTION=ignore
RUN pip install uv==0.13.9
WORKDIR /source
# What we build on changes seldom: a layer of its own.
COPY pyproject.toml uv.lock ./
RUN uv sync --frozen --no-dev --no-install-project
COPY . .
ARG COMMIT=""
RUN IMUSCOPE_COMMIT="$COMMIT" uv sync --frozen --no-dev --no-editable
RUN cd / && /app/bin/python -c "from imuscope.protocols.native import kernels; from imuscope.protocols.registry import families; assert kernels.is_complete()"

FROM python:3.13.12-slim-bookworm
COPY --from=build /app /app
RUN install -d -o 10001 -g 10001 /data
ENV PATH=/app/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
USER 10001:10001
WORKDIR /data
VOLUME /data
EXPOSE 8080
HEALTHCHECK --interval=10s --timeout=3s --start-period=20s \
    CMD ["python", "-c", "import ssl, urllib.request as u\ntry: u.urlopen('http://127.0.0.1:8080/healthz', timeout=1)\nexcept OSError: u.urlopen('https://127.0.0.1:8080/healthz', timeout=1, context=ssl._create_unverified_context())"]
ENTRYPOINT ["imuscope", "serve", "--host", "0.0.0.0", "--port", "8080", "--data", "/data"]
