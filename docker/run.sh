#!/usr/bin/env bash
# One command in the image, shut off: no network but its own loopback, no privileges, nothing kept but ./runs.
#   docker/run.sh                               walks
#   docker/run.sh rabbit evaluate --help        any other command
# IMAGE (rabbit), ENGINE (docker; podman) and NETWORK (none; host: this machine's `ros2` sees the graph) from the environment.
set -euo pipefail
mkdir -p runs
options=(--rm --init --network "${NETWORK:-none}" --cap-drop ALL --security-opt no-new-privileges)
options+=(--stop-timeout 30) # the launcher ends its nodes in order, and gives each 12 s
options+=(--volume "$PWD/runs:/walks/runs" --env HOME=/tmp)
[[ ! -t 0 || ! -t 1 ]] || options+=(--interactive --tty)
# What is written belongs to the caller; root's calls run as the image's own user.
((EUID)) && options+=(--user "$(id -u):$(id -g)") || chmod 1777 runs
exec "${ENGINE:-docker}" run "${options[@]}" "${IMAGE:-rabbit}" "$@"
