import pytest

from device.diameter.joint_verdict import joint_verdict


def said(verdict: str | None = None, **answers: bool | None) -> dict[str, object]:
    return {"answers": answers, "verdict": verdict}


@pytest.mark.parametrize(
    ("device", "operator", "final", "by"),
    [
        ("accept", None, "accept", "device"),
        ("retry", None, "retry", "device"),
        ("accept", said(), "accept", "device"),
        ("accept", said("accept"), "accept", "both"),
        ("accept", said("retry"), "retry", "operator"),
        ("retry", said("retry"), "retry", "both"),
        ("retry", said("accept"), "retry", "device"),
        ("accept", said(fit_aligned=False), "retry", "operator"),
        ("accept", said(fit_aligned=True, image_good=None), "accept", "device"),
        ("accept", said("accept", image_good=False), "accept", "both"),
    ],
)
def test_the_final_verdict(device: str, operator: dict[str, object] | None, final: str, by: str) -> None:
    assert joint_verdict(device, operator) == (final, by)
