# One image, two services, three platforms (linux/arm/v7, linux/arm64, linux/amd64), the same recipe on each:
# Debian's own Python 3.11, NumPy, lz4 and zstandard (no armv7 wheels exist for these), pinned wheels for the rest.

FROM --platform=$BUILDPLATFORM docker.io/library/node:20-slim AS web
WORKDIR /build
COPY package.json package-lock.json .npmrc ./
RUN npm ci --omit=dev --no-audit --no-fund
COPY scripts/vendor.mjs scripts/openlayers.mjs scripts/three.mjs scripts/
RUN node scripts/vendor.mjs

FROM --platform=$TARGETPLATFORM docker.io/library/debian:bookworm-slim AS python
# setuptools, wheel and Cython build pymavlink where no wheel exists (armv7): it needs no compiler.
RUN apt-get update \
 && apt-get install -y --no-install-recommends \
      cython3 python3 python3-lz4 python3-numpy python3-pip python3-setuptools python3-venv python3-wheel python3-zstandard \
 && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv --system-site-packages /opt/bluerov-slam
WORKDIR /build
COPY requirements/vehicle.lock requirements/build.lock requirements/
# The generator of pymavlink's dialects imports these two, and --no-build-isolation keeps unpinned tools out.
RUN /opt/bluerov-slam/bin/pip install --no-cache-dir --no-deps --require-hashes -r requirements/build.lock \
 && grep -v '^ *#' requirements/vehicle.lock > /tmp/vehicle.lock \
 && /opt/bluerov-slam/bin/pip install --no-cache-dir --no-deps --no-build-isolation --require-hashes -r /tmp/vehicle.lock
COPY pyproject.toml README.md LICENSE NOTICE ./
COPY config config
COPY src src
COPY web web
COPY --from=web /build/web/vendor web/vendor
RUN /opt/bluerov-slam/bin/pip install --no-cache-dir --no-deps --no-build-isolation . \
 && /opt/bluerov-slam/bin/pip uninstall --yes hatchling pluggy trove-classifiers pathspec \
 && cd /opt/bluerov-slam/lib/python3.11/site-packages/pymavlink \
 && find dialects/v10 dialects/v20 -type f ! -name '__init__.py' ! -name 'common.*' ! -name 'ardupilotmega.*' -delete \
 && rm -rf dialects/v09 message_definitions \
 && /opt/bluerov-slam/bin/pip uninstall --yes pip setuptools

FROM --platform=$TARGETPLATFORM docker.io/library/debian:bookworm-slim
RUN apt-get update \
 && apt-get install -y --no-install-recommends python3 python3-lz4 python3-numpy python3-zstandard \
 && rm -rf /var/lib/apt/lists/* /usr/share/doc /usr/share/man
COPY --from=python /opt/bluerov-slam /opt/bluerov-slam
ENV PATH=/opt/bluerov-slam/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    BLUEROV_SLAM_PATHS__STATE=/usr/blueos/extensions/bluerov-slam

EXPOSE 8099 8100 8101 8766 14555/udp 14556/udp
# "health" asks both services; a container that runs only one of them is asked with --only.
HEALTHCHECK --interval=30s --timeout=5s --start-period=20s CMD ["bluerov-slam", "health"]
CMD ["bluerov-slam", "run"]

ARG VERSION=0.1.0
LABEL version="${VERSION}"
# Not privileged: /dev with its serial ports (188 ttyUSB, 166 ttyACM, 204 ttyAMA) is all the hardware it needs.
LABEL permissions='{\
"NetworkMode": "host",\
"HostConfig": {\
"NetworkMode": "host",\
"DeviceCgroupRules": ["c 188:* rmw", "c 166:* rmw", "c 204:* rmw"],\
"Binds": [\
"/dev:/dev",\
"/usr/blueos/extensions/bluerov-slam:/usr/blueos/extensions/bluerov-slam",\
"/var/logs/blueos/extensions/bluerov-slam:/var/logs/blueos/extensions/bluerov-slam"\
],\
"Memory": 419430400,\
"CpuPeriod": 100000,\
"CpuQuota": 200000\
}\
}'
LABEL authors='[{"name": "BlueROV SLAM maintainers", "email": "maintainers@bluerov-slam.invalid"}]'
LABEL company='{"name": "BlueROV SLAM", "about": "Localization and side-scan sonar imaging for the BlueROV2", "email": "maintainers@bluerov-slam.invalid"}'
LABEL type="device-integration"
LABEL tags='["sonar", "side-scan", "navigation", "ctd", "data-collection"]'
LABEL links='{}'
LABEL requirements="core >= 1.1"
