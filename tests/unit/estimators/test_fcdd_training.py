"""The network and its loss; skipped where torch is not installed (dependency group ``train``)."""

from __future__ import annotations

import math

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed (dependency group train)")

from device.fcdd.features import without_border  # noqa: E402
from estimators.fcdd_training.context import Telling, fit_context, measure_textures, traits_of  # noqa: E402
from estimators.fcdd_training.network import (  # noqa: E402
    COMPONENTS,
    GAIN,
    Context,
    Fcdd,
    Same,
    Texture,
    Trunk,
    Whole,
    anomaly,
    loss,
    matrix_root,
    score,
)
from estimators.fcdd_training.placed import (  # noqa: E402
    MARGIN,
    CellRule,
    around,
    covered,
    fit_cells,
    grafted,
    witness,
)
from estimators.fcdd_training.training import Material, TrainConfig, fit  # noqa: E402


def test_the_transformation_of_eq_8() -> None:
    assert anomaly(torch.tensor([0.0, 3.0, -3.0])).tolist() == pytest.approx([0.0, math.sqrt(10) - 1, math.sqrt(10) - 1])


def test_the_loss_of_eq_9_by_hand() -> None:
    maps = torch.tensor([[[[1.0, 3.0]], [[0.5, 0.5]]]])  # one picture, two classes; z = 2 and 0.5
    assert score(maps).tolist() == [[2.0, 0.5]]
    labels = torch.tensor([[1.0, 0.0]])
    expected = (-math.log(1 - math.exp(-2.0)) + 0.5) / 2
    assert float(loss(maps, labels, torch.ones(1, 2))) == pytest.approx(expected, rel=1e-5)


def test_an_unknown_label_counts_for_nothing() -> None:
    maps = torch.rand(1, 2, 2, 2)
    weights = torch.tensor([[1.0, 0.0]])
    both = [float(loss(maps, torch.tensor([[1.0, y]]), weights)) for y in (0.0, 1.0)]
    assert both[0] == both[1]


@pytest.mark.parametrize("size", [(240, 320), (15, 20), (15, 21)])
@pytest.mark.parametrize(("kernel", "stride"), [(3, 2), (5, 2), (5, 1)])
def test_same_padding_gives_the_size_rounded_up(size: tuple[int, int], kernel: int, stride: int) -> None:
    found = Same(2, 3, kernel, stride)(torch.zeros(1, 2, *size))
    assert found.shape[2:] == (-(-size[0] // stride), -(-size[1] // stride))


def test_same_padding_puts_the_odd_pixel_at_the_end() -> None:
    layer = Same(1, 1, 3, 2)
    torch.nn.init.ones_(layer.weight)
    row = torch.zeros(1, 1, 4, 4)
    row[0, 0, 3, 3] = 1.0
    # windows of 3 begin at 0 and 2; the last pixel lies in the second
    assert layer(row)[0, 0].tolist() == [[0.0, 0.0], [0.0, 1.0]]


def test_folding_the_scales_changes_nothing() -> None:
    torch.manual_seed(1)
    net = Fcdd(5, 8).eval()
    for scale in net.head.scales:
        scale.running_mean.normal_()
        scale.running_var.uniform_(0.5, 2)
    features = tuple(torch.randn(2, width, *size) for width, size in ((80, (15, 20)), (112, (15, 20)), (320, (8, 10))))
    with torch.no_grad():
        before = net(features)
        net.head.fold()
        assert torch.allclose(before, net(features), rtol=1e-3, atol=1e-4)


def test_cutting_leaves_the_first_maps_as_they_were() -> None:
    torch.manual_seed(3)
    head = Fcdd(5, 8).eval().head
    features = tuple(torch.randn(1, width, *size) for width, size in ((80, (15, 20)), (112, (15, 20)), (320, (8, 10))))
    with torch.no_grad():
        before = head(features)
        head.cut(2)
        assert torch.allclose(before[:, :2], head(features), atol=1e-4)


def test_a_context_tells_what_its_pictures_look_like_and_no_rare_class() -> None:
    rng = np.random.default_rng(8)
    labels = np.zeros((90, 2), np.float32)
    labels[:40, 0] = 1
    labels[40:43, 1] = 1
    taps = [rng.normal(size=(2, 90, width, 3, 4)).astype(np.float16) for width in (80, 112, 320)]
    # the class is told by how uneven some channels are, which no mean knows
    taps[1][:, :, :40] *= np.where(labels[:, 0] > 0, 3, 1)[None, :, None, None, None].astype(np.float16)
    material = Material(tuple(taps), labels, np.ones_like(labels), np.full(90, 1 / 90), tuple(taps))
    context = Context((80, 112, 320), 2)
    rows = np.arange(0, 90, 2)
    measure_textures(context, material, rows)
    assert traits_of(context, material.features, rows).shape == (2, 45, context.rule.in_features)
    fit_context(context, material, np.ones(90, np.float32), rows, ("roots", "fracture"))
    with torch.no_grad():
        told = context(tuple(torch.from_numpy(tap[0][1::2].astype(np.float32)) for tap in taps)).numpy()
    positive = labels[1::2, 0] > 0
    assert told[positive, 0].mean() > told[~positive, 0].mean() + 0.8
    assert context.known.tolist() == [1.0, 0.0]
    assert (told[:, 1] == 0).all()


def test_a_class_without_context_is_told_by_its_map() -> None:
    torch.manual_seed(4)
    net = Fcdd(2, 8).eval()
    net.head.context.known[0] = 1.0
    features = tuple(torch.randn(1, width, *size) for width, size in ((80, (15, 20)), (112, (15, 20)), (320, (8, 10))))
    with torch.no_grad():
        maps, scores = net.told(features)
    assert scores[0, 0] == 0.5  # the rule knows nothing yet
    assert float(scores[0, 1]) == pytest.approx(1 - math.exp(-float(maps[0, 1].mean())), abs=1e-6)


def test_whole_network_gives_a_map_per_class() -> None:
    with torch.no_grad():
        maps, scores = Whole(Trunk(), Fcdd(5, 8)).eval()(torch.zeros(1, 3, 240, 320))
    assert maps.shape == (1, 5, 15, 20)
    assert scores.shape == (1, 5)
    assert float(maps.min()) >= 0


def _scores(net: Fcdd, taps: list[np.ndarray]) -> np.ndarray:
    with torch.no_grad():
        return score(net(tuple(torch.from_numpy(tap[0].astype(np.float32)) for tap in taps))).numpy()


def test_a_head_learns_what_can_be_seen_and_repeats_itself() -> None:
    rng = np.random.default_rng(5)
    labels = (rng.random((60, 2)) < 0.5).astype(np.float32)
    taps = [rng.normal(size=(2, 60, width, 2, 3)).astype(np.float16) for width in (80, 112, 320)]
    taps[1][:, :, :8] += labels[None, :, :1, None, None].astype(np.float16) * 2
    taps[2][:, :, :8] += labels[None, :, 1:, None, None].astype(np.float16) * 2
    material = Material(tuple(taps), labels, np.ones_like(labels), np.full(60, 1 / 60), ())
    config = TrainConfig(steps=60, batch=16, hidden=8, dropout=0.0, mixup=0.0, rate=1e-2)
    rows = np.arange(40)
    found = _scores(fit(material, rows, config, seed=1), taps)
    for column in range(2):
        unseen = found[40:, column]
        assert unseen[labels[40:, column] > 0].mean() > unseen[labels[40:, column] == 0].mean() + 0.3
    again = _scores(fit(material, rows, config, seed=1), taps)
    assert np.array_equal(found, again)


@pytest.mark.parametrize("alone", [True, False])
def test_a_grafted_rule_is_a_map_of_its_class_and_leaves_the_others(alone: bool) -> None:
    torch.manual_seed(2)
    head = Fcdd(3, 8).eval().head
    head.context.known[:] = 1.0
    features = tuple(torch.randn(1, width, *size) for width, size in ((80, (15, 20)), (112, (15, 20)), (320, (8, 10))))
    rule = CellRule(np.random.default_rng(6).normal(0, 0.05, 512).astype(np.float32), 0.3)
    with torch.no_grad():
        before, seen = head.told(features)
        grafted(head.places, 1, rule, 0.4, alone)
        after, told = head.told(features)
        coarse = torch.nn.functional.interpolate(features[2], size=(15, 20), mode="bilinear")
        side_by_side = torch.cat([*features[:2], coarse], dim=1).numpy()
    logits = rule.logits(side_by_side)[0]
    placed = np.sqrt((GAIN * np.clip(logits + MARGIN, 0, 6)) ** 2 + 1) - 1
    assert np.allclose(after[0, 1].numpy(), placed + (0 if alone else before[0, 1].numpy()), atol=2e-3)
    assert torch.allclose(before[:, [0, 2]], after[:, [0, 2]], atol=1e-5)
    # two witnesses: it is absent only where neither saw it
    assert float(1 - told[0, 1]) == pytest.approx(float(1 - seen[0, 1]) * math.exp(-0.4 * witness(logits)), rel=1e-3)
    assert torch.allclose(seen[:, [0, 2]], told[:, [0, 2]])


def test_moments_about_the_own_mean_do_not_know_the_colour_and_the_others_do() -> None:
    torch.manual_seed(5)
    texture = Texture(30)
    taps = torch.randn(20, 30, 6, 7)
    texture.measure(taps)
    with torch.no_grad():
        own, about_all, _, _ = texture(taps).unbind(dim=1)
        # over all pictures the components have mean 0, deviation 1 and nothing in common
        z = texture.project(taps).transpose(0, 1).flatten(1)
        assert torch.allclose(z @ z.T / z.shape[1], torch.eye(COMPONENTS), atol=2e-3)
        brighter, brighter_all, _, _ = texture(taps + 0.5).unbind(dim=1)
    assert own.shape == about_all.shape == (20, COMPONENTS, COMPONENTS)
    assert torch.allclose(own, brighter, atol=2e-3)
    assert float((about_all - brighter_all).abs().max()) > 0.1


def test_broad_moments_know_what_is_large_and_no_grain() -> None:
    torch.manual_seed(7)
    texture = Texture(30)
    texture.measure(torch.randn(20, 30, 12, 12))
    rows, columns = torch.meshgrid(torch.arange(12), torch.arange(12), indexing="ij")
    grain = ((rows + columns) % 2 * 2.0 - 1).expand(1, 30, 12, 12)
    half = ((rows >= 6) * 2.0 - 1).expand(1, 30, 12, 12)
    with torch.no_grad():
        (own, _, broad, _), (own_half, _, broad_half, _) = texture(grain)[0], texture(half)[0]
    assert torch.allclose(own, own_half, atol=1e-3)  # single cells differ as much in both
    # of 25 cells of a chequerboard 12 make up for 12 others; in a picture of two halves only four rows of twelve see both
    assert float(broad.trace() / own.trace()) < 0.02
    assert float(broad_half.trace() / own_half.trace()) > 0.7


def test_matrix_roots() -> None:
    torch.manual_seed(8)
    turned = torch.linalg.qr(torch.randn(6, 6))[0]
    values = torch.tensor([4.0, 2.0, 1.0, 1.0, 0.5, 0.5])
    known = turned @ torch.diag(values) @ turned.T
    root = matrix_root(torch.stack([known, 100 * known]))
    assert torch.allclose(root[0], turned @ torch.diag(values.sqrt()) @ turned.T, atol=0.02)
    assert torch.allclose(root[1], 10 * root[0], rtol=1e-4)
    assert (matrix_root(torch.zeros(6, 6)) == 0).all()


def test_a_class_that_is_told_by_some_depths_does_not_see_the_others() -> None:
    rng = np.random.default_rng(9)
    labels = (np.arange(60) % 2 == 0).astype(np.float32)[:, None]
    taps = [rng.normal(size=(2, 60, width, 3, 4)).astype(np.float16) for width in (80, 112, 320)]
    material = Material(tuple(taps), labels, np.ones_like(labels), np.full(60, 1 / 60), tuple(taps))
    context = Context((80, 112, 320), 1)
    measure_textures(context, material, np.arange(60))
    telling = Telling({"own root": 1.0, "broad own moments": 1.0}, taps=(7, 10))
    fit_context(context, material, np.ones(60, np.float32), np.arange(60), ("roots",), telling)
    parts = context.rule.weight[0].split([group.size for group in context.groups])
    used = {(group.kind, group.tap, group.inside) for group, part in zip(context.groups, parts, strict=True) if part.any()}
    assert used == {(kind, tap, False) for kind in telling.counts for tap in telling.taps}


def test_only_what_is_told_by_the_inside_is_learnt_from_closer_pictures() -> None:
    rng = np.random.default_rng(10)
    labels = np.repeat((np.arange(60) % 2 == 0).astype(np.float32)[:, None], 2, axis=1)
    taps = tuple(rng.normal(size=(2, 60, width, 7, 10)).astype(np.float16) for width in (80, 112, 320))
    shown = tuple(tap.copy() for tap in taps)
    shown[1][:, ::2, :40] *= 3
    context = Context((80, 112, 320), 2)
    measure_textures(context, Material(taps, labels, labels, labels[:, 0], shown), np.arange(60))
    for closer in (taps, shown):
        material = Material(taps, labels, np.ones_like(labels), np.full(60, 1 / 60), closer)
        for inside in (False, True):
            telling = Telling({"deviation": 1.0}, inside=inside)
            fit_context(context, material, np.ones(60, np.float32), np.arange(60), ("roots",), telling)
            with torch.no_grad():
                told = context(tuple(torch.from_numpy(tap[0].astype(np.float32)) for tap in shown))[:, 0]
            assert bool(told[::2].mean() > told[1::2].mean() + 1) == (inside and closer is shown)


def test_a_picture_without_its_border() -> None:
    picture = np.zeros((100, 200, 3), np.uint8)
    picture[7:93, 10:190, 0], picture[7:93, 10, 1] = 1, 1
    assert (without_border(picture, mirrored=False)[..., 0] == 1).all()
    assert without_border(picture, mirrored=True)[:, :, 1].nonzero()[1].tolist() == [179] * 86


def test_traits_of_the_inside_do_not_see_the_border() -> None:
    torch.manual_seed(6)
    context = Context((80, 112, 320), 2)
    plain = tuple(torch.randn(1, width, *size) for width, size in ((80, (15, 20)), (112, (15, 20)), (320, (8, 10))))
    written = tuple(tap.clone() for tap in plain)
    for tap, edge in zip(written, (2, 2, 1), strict=True):
        tap[:, :, :edge] = tap[:, :, -edge:] = 5.0
        tap[:, :, :, :edge] = tap[:, :, :, -edge:] = 5.0
    with torch.no_grad():
        alike = torch.isclose(context.traits(plain), context.traits(written))[0]
    inside = torch.cat([torch.full((group.size,), group.inside) for group in context.groups])
    assert alike[inside].all()
    assert not alike[~inside].any()


def test_cells_that_are_covered_by_half() -> None:
    # of 4 x 4 cells the lower left quarter, and a strip that covers less than half of the cells beside it
    assert covered([(0, 0.5), (0.6, 0.5), (0.6, 1), (0, 1)], (4, 4)).tolist() == [
        [False] * 4,
        [False] * 4,
        [True, True, False, False],
        [True, True, False, False],
    ]
    alone = np.zeros((4, 4), bool)
    alone[0, 0] = True
    assert around(alone).sum() == 4


def test_a_rule_of_cells_finds_the_direction_that_tells_them_apart() -> None:
    rng = np.random.default_rng(7)
    labels = (rng.random(400) < 0.1).astype(np.float32)
    cells = rng.normal(size=(400, 6)).astype(np.float32)
    cells[:, 2] += 4 * labels
    rule = fit_cells(cells, labels)
    logits = rule.logits(cells[:, :, None, None])[:, 0, 0]
    assert logits[labels > 0].min() > np.quantile(logits[labels == 0], 0.95)
    assert int(np.argmax(np.abs(rule.weight))) == 2
