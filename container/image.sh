#!/usr/bin/env bash
# Builds the image and tries it out, with docker, or with podman, which root on Debian gets installed.
#
#   make image                        IMAGE=smv_planner  ENGINE=docker|podman  BASE=image with Python  BASE_DIGEST=sha256:...
#
# Where the base can be had from no registry, Debian's packages make one: then the Dockerfile is tried, and all that is in
# the image but the base. The package index and its certificates, if they are your own: PIP_INDEX_URL and PIP_CERT.
set -euo pipefail
cd "$(dirname "$0")/.."

IMAGE=${IMAGE:-smv_planner}
OWN_BASE=localhost/debian-python:bookworm
work=$(mktemp -d)
service=
compose=()

clean_up() {
    for _ in 1 2; do # podman removes who holds the network only when all others are gone
        [ ${#compose[@]} = 0 ] || "${compose[@]}" down --volumes >/dev/null 2>&1 || true
    done
    [ -z "$service" ] || kill "$service" 2>/dev/null || true
    rm -rf "$work"
}
trap clean_up EXIT

say() { echo "image: $*" >&2; }

need() { # command, Debian packages
    command -v "$1" >/dev/null && return
    if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
        say "this machine lacks $1. As root: apt-get install ${*:2}"
        exit 1
    fi
    say "installing Debian packages: ${*:2}"
    apt-get -qq update
    DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "${@:2}" >"$work/apt.log" 2>&1 ||
        { cat "$work/apt.log" >&2; exit 1; }
}

if [ -z "${ENGINE:-}" ]; then
    if docker info >/dev/null 2>&1; then ENGINE=docker; else ENGINE=podman; fi
fi
engine=("$ENGINE")
build=()
if [ "$ENGINE" = podman ]; then
    need podman podman crun netavark
    build+=(--format docker) # the other format has no HEALTHCHECK
    if [ ! -d /run/systemd/system ]; then
        # Most likely we are in a container ourselves: nobody gives us cgroups or bridges, and limits can only be lowered.
        need crun crun
        cat >"$work/containers.conf" <<-CONF
			[containers]
			default_ulimits = ["nofile=$(ulimit -Sn):$(ulimit -Sn)", "nproc=4096:4096"]
			[engine]
			cgroup_manager = "cgroupfs"
			runtime = "crun"
			CONF
        export CONTAINERS_CONF=$work/containers.conf
        build+=(--network host)
        if mountpoint -q /sys/fs/cgroup/unified; then
            # crun refuses to work where it sees cgroups of both versions
            engine=(unshare --mount sh -c 'umount /sys/fs/cgroup/unified; exec "$@"' - podman)
        fi
    fi
fi

# ---------------------------------------------------------------------------------------------------------- build

if [ -z "${BASE:-}" ]; then
    BASE=$(sed -n 's/^ARG BASE=//p' Dockerfile)
    if ! "${engine[@]}" image inspect "$BASE" >/dev/null 2>&1 && ! "${engine[@]}" pull --quiet "$BASE" >/dev/null 2>"$work/pull.log"; then
        BASE=$OWN_BASE
        if ! "${engine[@]}" image inspect "$BASE" >/dev/null 2>&1; then
            say "no registry has the base: $(tail -n 1 "$work/pull.log")"
            say "making one of Debian's packages"
            need mmdebstrap mmdebstrap
            mmdebstrap --quiet --variant=minbase --include=python3,ca-certificates bookworm "$work/base.tar"
            "${engine[@]}" import "$work/base.tar" "$BASE" >/dev/null
            rm "$work/base.tar"
        fi
    fi
fi
build+=(--build-arg "BASE=$BASE" --build-arg "BASE_DIGEST=${BASE_DIGEST:-}")
[ -z "${PIP_INDEX_URL:-}" ] || build+=(--build-arg PIP_INDEX_URL)
[ -z "${PIP_CERT:-}" ] || build+=(--secret "id=certificates,src=$PIP_CERT")

say "building $IMAGE with $ENGINE from $BASE; some minutes the first time"
began=$SECONDS
if ! "${engine[@]}" build "${build[@]}" --tag "$IMAGE" . >"$work/build.log" 2>&1; then
    tail -n 40 "$work/build.log" >&2
    exit 1
fi
size=$("${engine[@]}" image inspect --format '{{.Size}}' "$IMAGE")
say "built in $((SECONDS - began)) s; $((size / 1000000)) MB"

# ------------------------------------------------------------------------------------------------------------ try

# As tightly as compose.yaml has it: nothing can be written to, nobody be reached, no privilege be had.
tight=(--read-only --tmpfs /tmp --network none --cap-drop ALL --security-opt no-new-privileges)

try() {
    say "trying: $*"
    "${engine[@]}" run --rm --no-healthcheck "${tight[@]}" "$IMAGE" "$@"
}

try smv-plan scenarios/door --goal "door.pos == opened" --second-opinion
try smv-planner demo scenarios/assembly_station --case e7

# The station of compose.yaml: a robot dies, the planner is killed and stands up again where it stood, and is sent home.
if [ "$ENGINE" = podman ]; then
    # podman speaks docker's language too, but takes names without a registry for docker's own
    "${engine[@]}" system service --time 0 "unix://$work/socket" >"$work/service.log" 2>&1 &
    service=$!
    export DOCKER_HOST=unix://$work/socket SMV_PLANNER_IMAGE=localhost/$IMAGE
else
    export SMV_PLANNER_IMAGE=$IMAGE
fi
if docker compose version >/dev/null 2>&1; then
    compose=(docker compose)
else
    need docker-compose docker-compose
    compose=(docker-compose)
fi
export COMPOSE_PROJECT_NAME=trial$$

compose() { "${compose[@]}" "$@" </dev/null >>"$work/compose.log" 2>&1; }

planner() { "${compose[@]}" exec -T planner smv-planner "$@" </dev/null 2>/dev/null; }

await() { # what, command ...
    for _ in {1..120}; do
        if "${@:2}"; then say "the station: $1"; return; fi
        sleep 0.5
    done
    say "the station: waited in vain until $1"
    "${compose[@]}" logs --tail 20 >&2
    exit 1
}

healthy() { planner health >/dev/null; }
noted() { "${compose[@]}" logs planner 2>/dev/null | grep "\"event\": \"$1\"" >/dev/null; }
in_epoch() { planner ask state | grep "epoch $1," >/dev/null; }
ended_well() { [ "$("${engine[@]}" inspect --format '{{.State.Status}} {{.State.ExitCode}}' "$container" 2>/dev/null)" = "exited 0" ]; }

compose up --detach
await "the planner is well" healthy
container=$("${compose[@]}" ps -q planner)
compose exec -T emulators smv-planner emulate scenarios/assembly_station --tell r1 dead
await "the planner misses the robot that died" noted lost
compose kill -s SIGKILL planner
compose up --detach planner
await "the planner was killed and is well again" healthy
await "it commands anew, as its journal has it" in_epoch 2
compose stop planner
await "it ends when it is told to" ended_well
say "$IMAGE works"
