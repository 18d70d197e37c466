"""schemathesis over the routes of a box: cases made from the document, answers held against it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import schemathesis
from flask import Flask
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import Case, GenerationMode
from schemathesis.config import SchemathesisConfig
from schemathesis.specs.openapi.checks import positive_data_acceptance

ENDLESS = "/api/v1/events"
"""Its answer has no end; tests/unit/web/test_events.py reads it."""


def operations(box: Flask | str) -> dict[str, Any]:
    """ "GET /api/v1/status" and so on: what schemathesis knows of each route that answers and ends.

    ``box`` is an application, or the address of one that is served.
    """
    # Sessions are tried by tests.bench.intrusion; here each case comes with a right one.
    config = SchemathesisConfig.from_dict({"generation": {"with-security-parameters": False}})
    path = "/api/v1/openapi.json"
    if isinstance(box, str):
        schema = schemathesis.openapi.from_url(box + path, config=config)
    else:
        schema = schemathesis.openapi.from_wsgi(path, box, config=config)
    found = [result.ok() for result in schema.get_all_operations()]
    return {operation.label: operation for operation in found if operation.path != ENDLESS}


def try_operation(operation: Any, headers: Callable[[], dict[str, str]], examples: int, begin: int) -> int:
    """Try one route with ``examples`` right and as many wrong cases; how many were tried.

    ``headers()`` are those of a session, asked for at each case since a case may have ended it. ``begin`` seeds the cases.
    Raises schemathesis' failure with the case as a curl command.
    """
    tried = 0
    for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):

        @seed(begin)
        @settings(
            max_examples=examples,
            deadline=None,
            database=None,
            phases=[Phase.explicit, Phase.generate],
            suppress_health_check=list(HealthCheck),
        )
        @given(case=operation.as_strategy(generation_mode=mode))
        def each(case: Case) -> None:
            nonlocal tried
            tried += 1
            # Excluded: 422 is in the document, but a schema cannot say all that it stands for (control characters).
            case.call_and_validate(headers=headers(), excluded_checks=[positive_data_acceptance])

        with suppress(Unsatisfiable):  # nothing can be wrong with a route that takes nothing
            each()
    return tried
