import pytest
from hypothesis import given
from hypothesis import strategies as st

from device import dn


@pytest.mark.parametrize(
    ("material", "size", "smallest", "largest"),
    [
        ("PVC", 200, 188.2, 190.2),  # EN 1401: 200 less two walls of 5.9 (SN 8) or 4.9 (SN 4)
        ("PVC", 400, 376.6, 380.4),  # 400 less two walls of 11.7 or 9.8
        ("concrete", 300, 295.5, 304.5),
    ],
)
def test_interior_by_hand(material: str, size: int, smallest: float, largest: float) -> None:
    (found,) = [c for c in dn.classes(material) if c.dn == size]
    assert found.smallest_mm == pytest.approx(smallest, abs=0.3)
    assert found.largest_mm == pytest.approx(largest, abs=0.4)


@pytest.mark.parametrize(
    ("diameter", "material", "name"),
    [(378.0, "PVC", "DN 400"), (378.0, None, "DN 400"), (199.0, "concrete", "DN 200"), (1103.0, "concrete", "DN 1100")],
)
def test_class_of_a_good_measurement(diameter: float, material: str | None, name: str) -> None:
    guess = dn.guess(diameter, 1.5, material)
    assert guess.name == name
    assert guess.probability > 0.9


def test_a_pipe_between_the_series_gets_no_class() -> None:
    assert dn.guess(318.0, 1.5, "PVC").name is None


def test_a_vague_measurement_leaves_several_classes() -> None:
    guess = dn.guess(225.0, 20.0, "concrete")
    assert guess.probability < 0.6
    assert {name for name, _ in guess.alternatives} >= {"DN 200", "DN 250"} - {guess.name}


@given(st.floats(100, 1300), st.floats(0.5, 60))
def test_probabilities_are_probabilities(diameter: float, std: float) -> None:
    guess = dn.guess(diameter, std)
    assert 0 < guess.probability <= 1 + 1e-9
    assert guess.probability + sum(p for _, p in guess.alternatives) <= 1 + 1e-9 or guess.name is None


def test_reference_from_the_map() -> None:
    assert dn.agrees(378, 400, "PVC")
    assert not dn.agrees(330, 400, "PVC")
    assert dn.agrees(415, 400, "concrete")
    assert dn.agrees(345, 340, None)  # a size that no table knows is taken at its word
    assert not dn.agrees(290, 340, None)


def test_unknown_material_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown material 'cheese'"):
        dn.guess(200, 1, "cheese")
