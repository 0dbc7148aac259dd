#!/usr/bin/env bash
# Builds docker/debian.Dockerfile without Docker, from nothing, and walks in the image as its user. debootstrap makes the
# base; buildah builds on it, under chroot and with plain copies for layers, so it needs neither a daemon nor overlayfs.
# As root, with both from Debian:
#
#   docker/build_with_buildah.sh STORE [COMMAND ...]
#
# STORE is a new or empty folder for all that is made (some 15 GB on the way); COMMAND is `rabbit walk` unless given.
# From the environment, all optional:
#   MIRROR                               Debian mirror; debootstrap's own unless given
#   CA_BUNDLE                            file of certificates that pip is to trust
#   WHEELS                               folder of wheels beside pip's index, such as a CPU build of torch
#   PIP_INDEX_URL, PIP_EXTRA_INDEX_URL   as pip takes them
set -euo pipefail
store=$(realpath -m "${1:?usage: docker/build_with_buildah.sh STORE [COMMAND ...]}")
shift
(($#)) || set -- rabbit walk
command=("$@")
((EUID == 0)) || { echo "debootstrap needs root" >&2; exit 2; }
[[ ! -e $store || -z $(ls -A "$store") ]] || { echo "STORE $store: expected a new or empty folder" >&2; exit 2; }
mkdir -p "$store"
cd "$(dirname "${BASH_SOURCE[0]}")/.."
export BUILDAH_ISOLATION=chroot

in_store() { buildah --storage-driver vfs --root "$store/images" --runroot "$store/run" "$@"; }
told() { local from=$SECONDS what=$1; shift; "$@"; echo "== $what: $((SECONDS - from)) s"; }

base() {
  local container
  container=$(in_store from scratch)
  debootstrap --variant=minbase bookworm "$(in_store mount "$container")" ${MIRROR:+"$MIRROR"}
  in_store run "$container" -- apt-get clean
  in_store commit --rm "$container" bookworm
}

image() {
  local options=()
  [[ -z ${CA_BUNDLE:-} ]] || options+=(--volume "$(realpath "$CA_BUNDLE"):/ca.pem:ro" --build-arg PIP_CERT=/ca.pem)
  [[ -z ${WHEELS:-} ]] || options+=(--volume "$(realpath "$WHEELS"):/wheels:ro" --build-arg PIP_FIND_LINKS=/wheels)
  for name in PIP_INDEX_URL PIP_EXTRA_INDEX_URL; do
    [[ -z ${!name+given} ]] || options+=(--build-arg "$name=${!name}")
  done
  in_store build "${options[@]}" --pull-never --build-arg BASE=localhost/bookworm --file docker/debian.Dockerfile --tag rabbit .
}

walk() {
  local container
  container=$(in_store from --pull-never localhost/rabbit)
  inside() { in_store run "$container" -- /opt/rabbit/docker/entrypoint.sh "$@"; }
  echo "as $(inside id)"
  [[ $(inside id -u) != 0 ]] || { echo "the image runs as root" >&2; exit 1; }
  inside "${command[@]}"
  cp -r "$(in_store mount "$container")/walks/runs" "$store/runs"
}

told base base
told image image
in_store images
told walk walk
