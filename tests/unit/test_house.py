"""The house rule of DESIGN: imports run one way."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MAY_IMPORT = {
    "web_ui": {"web_ui", "device"},
    "device": {"device", "drivers", "estimators"},
    "drivers": {"drivers", "estimators.pinhole"},
    "estimators": {"estimators"},
}
UNKNOWN_TO_ESTIMATORS = {
    "time",
    "datetime",
    "threading",
    "multiprocessing",
    "socket",
    "pathlib",
    "os",
    "io",
    "random",
    "logging",
}


def imported(path: Path) -> list[str]:
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: absolute imports only"
            names.append(node.module or "")
    return names


def sources(room: str) -> list[Path]:
    found = sorted((ROOT / room).rglob("*.py"))
    assert found, f"no source in {room}"
    return found


@pytest.mark.parametrize("room", MAY_IMPORT)
def test_imports_run_one_way(room: str) -> None:
    for path in sources(room):
        for name in imported(path):
            if name.split(".")[0] not in MAY_IMPORT:
                continue
            if path.name == "serve_command.py" and name.startswith("web_ui."):
                continue  # the one place that puts the house together
            allowed = any(name == rule or name.startswith(rule + ".") for rule in MAY_IMPORT[room])
            assert allowed, f"{path.relative_to(ROOT)} imports {name}"


def test_estimators_know_no_clock_thread_file_or_socket() -> None:
    for path in sources("estimators"):
        for name in imported(path):
            assert name.split(".")[0] not in UNKNOWN_TO_ESTIMATORS, f"{path.relative_to(ROOT)} imports {name}"
