"""schemathesis against `borescout serve --virtual`: cases tried and what it found, by route.

python -m tests.bench.api_schema [--examples 60] [--seed 1]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import urllib.error
import urllib.request
from collections import Counter
from pathlib import Path

from schemathesis.core.failures import FailureGroup

from tests.api_schema import operations, try_operation
from tests.bench.daemon import running
from tests.bench.table import print_table
from tests.pairing import Pass, pair


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--examples", type=int, default=60, help="right cases, and as many wrong ones, for each route")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    tried: Counter[str] = Counter()
    found: list[tuple[str, str]] = []
    with tempfile.TemporaryDirectory(prefix="borescout-schema-") as folder, running(Path(folder), ["--virtual"]) as (_, port):
        session = _Session(port)
        for label, operation in operations(f"http://127.0.0.1:{port}").items():
            try:
                tried[label] = try_operation(operation, session.headers, chosen.examples, chosen.seed)
            except (Exception, FailureGroup) as failure:  # noqa: BLE001  # whatever schemathesis raises is a finding
                whole = failure.exceptions if isinstance(failure, FailureGroup) else [failure]
                found += [(label, str(one).strip().splitlines()[0]) for one in whole]
        refused = _answer(port, "/api/v1/status", {}) == 401 and _answer(port, "/api/v1/status", session.headers()) == 200
    print_table("schemathesis over the virtual box", ("route", "cases"), [(label, count) for label, count in tried.items()])
    print_table("Found", ("route", "what"), found or [("–", "nothing")])
    print(f"  routes {len(tried)}, cases {sum(tried.values())}, findings {len(found)}; still answering: {refused}")
    sys.exit(1 if found or not refused else 0)


class _Session:
    """A session that controls the box, paired again where a case has ended it."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._pass: Pass = pair(port)

    def headers(self) -> dict[str, str]:
        if _answer(self._port, "/api/v1/status", self._pass.headers) == 401:
            self._pass = pair(self._port, source=f"127.0.3.{len(self._pass.cookie) % 250 + 1}")
        body = json.dumps({}).encode()
        asked = urllib.request.Request(
            f"http://127.0.0.1:{self._port}/api/v1/control/ask",
            body,
            {"Content-Type": "application/json", **self._pass.headers},
        )
        urllib.request.urlopen(asked, timeout=30).close()
        return self._pass.headers


def _answer(port: int, path: str, headers: dict[str, str]) -> int:
    try:
        with urllib.request.urlopen(
            urllib.request.Request(f"http://127.0.0.1:{port}{path}", headers=headers), timeout=30
        ) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


if __name__ == "__main__":
    main()
