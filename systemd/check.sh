#!/bin/sh
# The units as systemd reads them: no complaint, and an exposure of at most 1.8 of 10 for each service.
set -eu
if ! command -v systemd-analyze >/dev/null; then
  echo "the units are not checked: systemd-analyze is not installed (apt install systemd)"
  exit 0
fi
here=$(cd "$(dirname "$0")" && pwd)
units=$(mktemp -d)
trap 'rm -rf "$units"' EXIT
for unit in "$here"/*.service "$here"/*.timer "$here"/*.mount; do
  sed 's#/opt/borescout/bin/borescout#/bin/true#' "$unit" >"$units/$(basename "$unit")" # it is not installed here
done
said=$(systemd-analyze verify "$units"/* 2>&1) || { echo "$said" >&2; exit 1; }
if printf '%s\n' "$said" | grep -q "$units"; then echo "$said" >&2; exit 1; fi
for service in "$here"/*.service; do
  systemd-analyze security --offline=true --threshold=18 "$service" | tail -n 1
done
