"""What a map says of an object beside the descriptor: the pipes that leave it, what stands above it, how far a pipe goes."""

from __future__ import annotations

import numpy as np
import pytest

from device.structure.in_order import InOrder
from drivers.navigation.readings import Depth
from drivers.navigation.scans import Scan
from estimators.structure.coverage import Coverage
from estimators.structure.handles import HIGH, LOW, NONE, handle_height
from estimators.structure.objects_map import HIDDEN, ObjectRecord
from estimators.structure.recognition import ports_likelihood
from estimators.structure.types import CLASSES

X, Y, Z = np.eye(3)


def likeliest(pipes: np.ndarray, sightings: int) -> set[str]:
    likelihood = ports_likelihood(pipes, sightings)
    return {label for label, value in zip(CLASSES, likelihood, strict=True) if value > 0.99 * likelihood.max()}


@pytest.mark.parametrize(
    ("pipes", "labels"),
    [
        ([X, -X, Y], {"tee", "3-way valve"}),
        ([X, Y], {"elbow"}),
        ([X, -X], {"ball valve", "socket", "butterfly valve"}),
    ],
)
def test_after_many_sightings_the_pipes_tell_the_kind(pipes: list[np.ndarray], labels: set[str]) -> None:
    assert likeliest(np.array(pipes), 30) == labels


def test_one_pipe_is_sooner_the_end_of_a_valve_than_two_open_ports() -> None:
    ball, three = (CLASSES.index(label) for label in ("ball valve", "3-way valve"))
    late, early = ports_likelihood(X[None], 30), ports_likelihood(X[None], 1)
    assert late[ball] > 5 * late[three]
    assert early[ball] < 2 * early[three], "after one sighting the other pipes may only not have been seen"


def test_probabilities_of_all_dispositions_sum_to_one() -> None:
    elbow = CLASSES.index("elbow")
    shown = [np.zeros((0, 3)), X[None], np.array([X, Y])]
    assert sum(ports_likelihood(pipes, 4)[elbow] for pipes in shown) == pytest.approx(1.0, abs=0.02)


def ring(along: float, radius: float, count: int = 40) -> np.ndarray:
    turn = np.linspace(0, 2 * np.pi, count)
    return np.column_stack([np.full(count, along), radius * np.cos(turn), radius * np.sin(turn)])


def test_what_stands_above_an_object_is_told_from_its_pipes() -> None:
    body = np.vstack([ring(x, 0.04) for x in np.linspace(-0.1, 0.1, 9)])
    stem = np.column_stack([np.zeros(12), np.zeros(12), np.linspace(0.05, 0.10, 12)])
    straight = np.array([X, -X])
    assert handle_height(body, np.zeros(3), straight) == NONE
    assert handle_height(np.vstack([body, stem]), np.zeros(3), straight) == LOW
    assert handle_height(np.vstack([body, stem * [1, 1, 1.8]]), np.zeros(3), straight) == HIGH
    branched = np.array([X, -X, Z])
    assert handle_height(np.vstack([body, stem * [1, 1, 1.8]]), np.zeros(3), branched) == NONE, "that is the branch"
    assert handle_height(body, np.zeros(3), np.zeros((0, 3))) is None


def test_a_short_piece_that_few_scans_saw_beyond_a_hole_is_no_pipe() -> None:
    pipe, beyond, longer = np.arange(0, 0.8, 0.01), np.arange(1.0, 1.1, 0.01), np.arange(1.0, 1.3, 0.01)
    for more, seen, end in ((beyond, 3, 0.8), (beyond, 20, 1.1), (longer, 3, 1.3)):
        coverage = Coverage()
        for scan in range(40):
            coverage.add(np.concatenate([pipe, more]) if scan < seen else pipe)
        assert coverage.ends() == pytest.approx((0.0, end), abs=0.03)


def test_a_pipe_ends_where_most_scans_saw_it_end_on_both_sides_of_its_origin() -> None:
    """Not where the furthest of many scans did, nor where the slots end; some scans see only a part of it."""
    rng = np.random.default_rng(0)
    coverage = Coverage()
    for scan in range(60):
        begin, end = np.array([-0.413, 0.447]) + rng.normal(0, 0.008, 2)
        if scan % 3 == 0:
            begin = rng.uniform(-0.35, 0.0)
        coverage.add(np.append(np.arange(begin, end, 0.02), end))
    assert coverage.ends() == pytest.approx((-0.413, 0.447), abs=0.004)


def test_how_often_something_on_a_pipe_could_have_been_seen() -> None:
    coverage = Coverage()
    for scan in range(20):
        coverage.add(np.arange(0.0, 0.5 if scan < 15 else 1.5, 0.01))
    assert (coverage.shown(0.2), coverage.shown(0.65), coverage.shown(1.0), coverage.shown(3.0)) == (20, 20, 5, 0)
    assert coverage.shown(-1e3) == coverage.shown(1e3) == 0


def test_sightings_of_one_object_do_not_add_up_as_if_they_were_independent() -> None:
    record = ObjectRecord()
    for _ in range(50):
        record.evidence = record.evidence + np.log([0.3, 0.1, 0.2, 0.1, 0.1, 0.2])
        record.seen_from.append(X)
    assert 0.8 < record.semantic().max() < 0.999


def test_a_handle_that_is_never_seen_is_hidden_or_not_there() -> None:
    """By hand: nothing above it in a hundred scans leaves a valve as likely as its handle is to be hidden."""
    record = ObjectRecord()
    bare, low_handle, high_handle = [0.9, 0.09, 0.01], [0.1, 0.89, 0.01], [0.1, 0.01, 0.89]
    stands = np.array([low_handle, bare, bare, bare, high_handle, low_handle])
    nothing, low = np.log(stands[:, 0]), np.log(stands[:, 1])
    record.handles = 100 * nothing
    record.seen_from = [X] * 100
    assert record.semantic()[0] / record.semantic()[1] == pytest.approx(HIDDEN, rel=0.01)
    record.handles = 40 * nothing + 60 * low
    assert record.semantic()[[0, 5]].sum() > 0.5
    assert record.semantic()[0] == pytest.approx(record.semantic()[5])
    assert record.semantic()[4] < 0.01


def test_single_and_fused_scans_of_the_same_sightings_count_once() -> None:
    once = np.log([0.3, 0.1, 0.2, 0.1, 0.1, 0.2])
    record = ObjectRecord(evidence=3 * once, fused=3 * once, seen_from=[X] * 3)
    np.testing.assert_allclose(record.together(), record.semantic())
    record.fused = 3 * np.log([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
    assert record.semantic()[0] < record.together()[0]


def test_scans_and_readings_come_out_in_the_order_of_their_times() -> None:
    order = InOrder(patience_s=3.0)
    for time_s in (1.0, 2.0, 3.0, 1.5):
        order.add(Depth(time_s, 4.0, 0.02))
    freed = order.until(Scan(2.5, np.zeros((1, 3))), now_s=3.0)
    assert [event.time_s for event in freed] == [1.0, 1.5, 2.0, 2.5]
    assert order.until(Scan(1.8, np.zeros((1, 3))), now_s=3.1) == []
    order.add(Depth(2.2, 4.0, 0.02))
    assert order.late == 2
    assert order.waited(5.9) == []
    assert [event.time_s for event in order.waited(6.1)] == [3.0]
    slow = Scan(10.0, np.zeros((1, 3)))
    order.add(Depth(16.0, 4.0, 0.02))
    order.until(slow, now_s=18.0)
    assert order.waited(20.0) == [], "a slow scanner is waited for longer from then on"
