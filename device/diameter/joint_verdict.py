"""The final verdict: what the device measured joined with what the operator saw."""

from __future__ import annotations

from typing import Any


def joint_verdict(device: str, operator: dict[str, Any] | None) -> tuple[str, str]:
    """(final verdict "accept" or "retry", who decided it: "device", "operator" or "both").

    ``operator`` is {"answers": {question: bool or None}, "verdict": "accept", "retry" or None, ...}. The operator refuses by
    saying so, or by answering a question with no without a verdict. Nobody turns the device's refusal into an acceptance.
    """
    said = operator_verdict(operator)
    if said is None:
        return device, "device"
    if device == "retry":
        return "retry", "both" if said == "retry" else "device"
    return (said, "both") if said == "accept" else ("retry", "operator")


def operator_verdict(operator: dict[str, Any] | None) -> str | None:
    """The operator's own verdict: stated, or "retry" where a question was answered with no; None without either."""
    if operator is None:
        return None
    stated = operator.get("verdict")
    if stated is not None:
        return str(stated)
    return "retry" if False in operator.get("answers", {}).values() else None
