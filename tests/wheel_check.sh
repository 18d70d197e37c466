#!/bin/sh
# Install the wheel in a clean venv, start the daemon with the virtual sewer, and ask it how it is.
set -eu
work=$(mktemp -d)
daemon=
trap 'test -z "$daemon" || kill "$daemon" 2>/dev/null; rm -rf "$work"' EXIT
"${PYTHON:-python3}" -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --require-hashes -r requirements/run.txt
"$work/venv/bin/pip" install --quiet --disable-pip-version-check --no-deps dist/borescout-*.whl
cd "$work"
"$work/venv/bin/borescout" serve --virtual --port 8931 --pin 123456 --data-dir "$work/data" >"$work/log" 2>&1 &
daemon=$!
for _ in $(seq 60); do
  if "$work/venv/bin/python" - <<'PY'; then
import json, sys, urllib.request
try:
    box = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    root, pin = "http://127.0.0.1:8931", json.dumps({"pin": "123456"}).encode()
    box.open(urllib.request.Request(f"{root}/api/v1/session", pin, {"Content-Type": "application/json"}), timeout=2)
    status = json.load(box.open(f"{root}/api/v1/status", timeout=2))
    page = box.open(f"{root}/", timeout=2).read()
except OSError:
    sys.exit(1)
sys.exit(not (b"<html" in page and any(camera["state"] == "up" for camera in status["cameras"])))
PY
    echo "wheel installed, started and answering"
    exit 0
  fi
  sleep 1
done
cat "$work/log"
echo "the wheel did not answer within a minute" >&2
exit 1
