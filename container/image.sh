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
trap 'rm -rf "$work"' EXIT

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
try smv-planner demo
say "$IMAGE works"
