# The planner in a container: `make image` builds it and tries it out; compose.yaml runs a whole station.
#
#   docker run IMAGE                                          the daemon, for the scenario named at the end of this file
#   docker run IMAGE smv-plan scenarios/door --goal ...       a plan
#
# The base is named by its tag. To fix it, give its digest too: --build-arg BASE_DIGEST=sha256:...
# Certificates of your own, if the package index has such, come as a secret: --secret id=certificates,src=FILE

ARG BASE=docker.io/library/python:3.11-slim-bookworm
ARG BASE_DIGEST=

# ------------------------------------------------------------------- builder: compilers, NuSMV from source, our package
FROM ${BASE}${BASE_DIGEST:+@${BASE_DIGEST}} AS builder

ARG PIP_INDEX_URL
ENV PIP_CERT=/run/secrets/certificates PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore \
    PIP_DEFAULT_TIMEOUT=120
WORKDIR /build

# NuSMV takes minutes and its recipe alone decides what comes out, so it comes first and stays in the cache of layers.
# The recipe knows what the base lacks: the slim image of Python needs other packages than Debian's Python.
COPY smv_planner/nusmv_build.py .
RUN apt-get -qq update \
 && DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends $(python3 nusmv_build.py --missing)
RUN --mount=type=secret,id=certificates \
    [ -e "$PIP_CERT" ] || unset PIP_CERT; \
    python3 nusmv_build.py --out wheels && rm -r ~/.cache/smv_planner

# Where the last stage has it, because programs of a virtual environment name their interpreter. Without pip.
RUN python3 -m venv tools && python3 -m venv --without-pip /opt/smv_planner/.venv
COPY pyproject.toml README.md LICENSE ./
COPY bridge bridge
COPY smv_templates smv_templates
COPY smv_planner smv_planner
RUN --mount=type=secret,id=certificates \
    [ -e "$PIP_CERT" ] || unset PIP_CERT; \
    tools/bin/pip --quiet --python /opt/smv_planner/.venv install --find-links wheels '.[nusmv]'
COPY scenarios /opt/smv_planner/scenarios

# ---------------------------------------------------------------------- what runs: Python, the environment, scenarios
FROM ${BASE}${BASE_DIGEST:+@${BASE_DIGEST}}

COPY --from=builder /opt/smv_planner /opt/smv_planner
# Where the journals are, by cell. An empty volume that is mounted there takes this owner.
RUN install -d -o 65532 -g 65532 -m 0700 /var/lib/smv_planner

# Nothing else is written to but /tmp, so the root file system may be read-only: --read-only --tmpfs /tmp
ENV PATH=/opt/smv_planner/.venv/bin:$PATH HOME=/var/lib/smv_planner XDG_STATE_HOME=/var/lib \
    PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1
WORKDIR /opt/smv_planner
USER 65532:65532
VOLUME /var/lib/smv_planner

# Exec form, here and below: signals reach the program itself, and there need not be a shell.
HEALTHCHECK --interval=5s --timeout=5s --start-period=30s --retries=3 CMD ["smv-planner", "health"]
CMD ["smv-planner", "run", "scenarios/assembly_station"]
