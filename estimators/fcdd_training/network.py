"""The network: an EfficientNet-Lite0 trunk and a head of 1 x 1 convolutions with one anomaly map per class, at a stride of 16.

Trunk: EfficientNet-Lite0 (Tan and Le 2019 without squeeze-and-excite, ReLU6 throughout), 'same' padding as TensorFlow does it,
batch-norm eps 1e-3. Head: eqs. 8 and 9 of the CCTV paper.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

BLOCKS = (
    # kernel, stride, expansion, channels out
    (3, 1, 1, 16),
    (3, 2, 6, 24),
    (3, 1, 6, 24),
    (5, 2, 6, 40),
    (5, 1, 6, 40),
    (3, 2, 6, 80),
    (3, 1, 6, 80),
    (3, 1, 6, 80),
    (5, 1, 6, 112),
    (5, 1, 6, 112),
    (5, 1, 6, 112),
    (5, 2, 6, 192),
    (5, 1, 6, 192),
    (5, 1, 6, 192),
    (5, 1, 6, 192),
    (3, 1, 6, 320),
)
STEM = 32
TAPS = (7, 10, 15)
"""Blocks that the head looks at: texture and edges at a stride of 16 pixels, parts of things there, whole things at 32."""
COMPONENTS = 24
"""Of a tap, whose second moments are looked at; with 48 unseen archives are told apart worse."""
MOMENTS = ("own moments", "moments", "broad own moments", "broad moments")
"""Second moments of a tap's components about their own mean and about that of all pictures; the broad ones are those of what
surrounds each cell, in which noise and fine grain, by which archives differ, are gone."""
TRAITS = ("mean", "deviation", *MOMENTS, "own root")
"""Of a tap: mean and deviation of its channels, moments, and the matrix root of its own moments."""
BROAD = 5
"""Cells across what surrounds a cell."""
NEWTON = 5
"""Steps to a matrix root."""
EDGE = (7, 10)
"""Shares of height and width that are left out at each side where a class is looked for inside: texts, clocks and letterboxes,
by which every archive can be known."""
GAIN = 3.5
"""The slope of a map that is learnt from places: a sure cell (6) has an anomaly of 20."""


class Same(nn.Conv2d):
    """A convolution without bias and with 'same' padding, the odd pixel at the right and below (TensorFlow)."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int = 1, groups: int = 1) -> None:
        super().__init__(inputs, outputs, kernel, stride, groups=groups, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """(n, inputs, h, w) to (n, outputs, ceil(h / stride), ceil(w / stride))."""
        kernel, stride = self.kernel_size[0], self.stride[0]
        across, down = (
            max((-(-size // stride) - 1) * stride + kernel - size, 0) for size in (int(x.shape[3]), int(x.shape[2]))
        )
        if across % 2 == 0 and down % 2 == 0:
            return functional.conv2d(x, self.weight, None, self.stride, (down // 2, across // 2), 1, self.groups)
        x = functional.pad(x, (across // 2, across - across // 2, down // 2, down - down // 2))
        return functional.conv2d(x, self.weight, None, self.stride, 0, 1, self.groups)


def _norm(channels: int) -> nn.BatchNorm2d:
    return nn.BatchNorm2d(channels, eps=1e-3, momentum=0.01)


class Block(nn.Module):
    """An inverted residual block."""

    def __init__(self, inputs: int, kernel: int, stride: int, expansion: int, outputs: int) -> None:
        super().__init__()
        inside = inputs * expansion
        self.widens = expansion != 1
        if self.widens:
            self._expand_conv, self._bn0 = Same(inputs, inside, 1), _norm(inside)
        self._depthwise_conv, self._bn1 = Same(inside, inside, kernel, stride, inside), _norm(inside)
        self._project_conv, self._bn2 = Same(inside, outputs, 1), _norm(outputs)
        self.skips = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        """Expand, look around, project, add."""
        y = functional.relu6(self._bn0(self._expand_conv(x))) if self.widens else x
        y = functional.relu6(self._bn1(self._depthwise_conv(y)))
        y = self._bn2(self._project_conv(y))
        return x + y if self.skips else y


class Trunk(nn.Module):
    """The trunk up to the last of ``TAPS``."""

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem, self._bn0 = Same(3, STEM, 3, 2), _norm(STEM)
        widths = (STEM, *(block[3] for block in BLOCKS))
        self._blocks = nn.ModuleDict({str(k): Block(widths[k], *block) for k, block in enumerate(BLOCKS)})

    def forward(self, x: Tensor) -> tuple[Tensor, ...]:
        """Pictures (n, 3, h, w), RGB as (x - 127) / 128, to the features of ``TAPS``."""
        found = []
        x = functional.relu6(self._bn0(self._conv_stem(x)))
        for name, block in self._blocks.items():
            x = block(x)
            if int(name) in TAPS:
                found.append(x)
        return tuple(found)

    def load(self, weights: Mapping[str, Tensor]) -> None:
        """Its share of the weights of a whole EfficientNet-Lite0."""
        own = self.state_dict()
        self.load_state_dict({name: weights[name] for name in own})


class Texture(nn.Module):
    """How the leading components of a tap vary together over the picture: bilinear pooling (Lin et al. 2015) of COMPONENTS
    channels, whose projection is that of ``measure`` and is not trained.

    The second moments about the picture's own mean know nothing of its colour and light, those about the mean of all pictures
    do.
    """

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.project = nn.Conv2d(channels, COMPONENTS, 1).requires_grad_(False)

    def measure(self, tap: Tensor) -> None:
        """Project on the principal components of ``tap`` (n, channels, h, w), each to mean 0 and deviation 1."""
        cells = tap.transpose(0, 1).flatten(1)
        mean = cells.mean(dim=1)
        values, vectors = torch.linalg.eigh(torch.cov(cells))
        leading = (vectors[:, -COMPONENTS:] * torch.rsqrt(values[-COMPONENTS:] + 1e-6)).T
        with torch.no_grad():
            self.project.weight.copy_(leading[:, :, None, None])
            self.project.bias.copy_(-leading @ mean)  # type: ignore[union-attr]

    def forward(self, tap: Tensor) -> Tensor:
        """The matrices of MOMENTS (n, 4, COMPONENTS, COMPONENTS)."""
        cells = self.project(tap)
        broad = functional.avg_pool2d(cells, BROAD, 1, BROAD // 2, count_include_pad=False)
        return torch.stack([moments for part in (cells, broad) for moments in _second_moments(part)], dim=1)


def _second_moments(components: Tensor) -> tuple[Tensor, Tensor]:
    """Of (n, k, h, w): (n, k, k) about the own mean of each, and about 0."""
    z = components.flatten(2)
    mean = z.mean(dim=2, keepdim=True)
    own = torch.matmul(z - mean, (z - mean).transpose(1, 2)) / z.shape[2]
    return own, own + torch.matmul(mean, mean.transpose(1, 2))


def matrix_root(moments: Tensor) -> Tensor:
    """Square roots of covariances (..., k, k) by NEWTON steps of Newton and Schulz, as Li et al. 2018 pool them: what varies
    most does not tell everything, in whatever direction it lies. Directions that hardly vary stay below their root."""
    one = torch.eye(moments.shape[-1])
    trace = (moments * one).sum(dim=(-2, -1), keepdim=True) + 1e-6
    root, inverse = moments / trace, one.expand(moments.shape)
    for _ in range(NEWTON):
        turn = 1.5 * one - 0.5 * torch.matmul(inverse, root)
        root, inverse = torch.matmul(root, turn), torch.matmul(turn, inverse)
    return root * torch.sqrt(trace)


@dataclass(frozen=True)
class Group:
    """``size`` traits of one ``kind`` (TRAITS) of one ``tap`` (TAPS), of the ``inside`` of the picture or of the whole."""

    kind: str
    tap: int
    inside: bool
    size: int


class Context(nn.Module):
    """Whether the picture as a whole shows a class: a linear rule on what each tap is like over the picture, its traits.

    Maps of small cells say where a thing is, but the mean of a map (z of eq. 9) tells pictures of unknown cameras apart worse
    than this rule does. It is fitted by itself (context.py); classes without one are told by their maps.
    """

    above: Tensor

    def __init__(self, widths: Sequence[int], classes: int) -> None:
        super().__init__()
        self.textures = nn.ModuleList(Texture(width) for width in widths)
        pairs = COMPONENTS * (COMPONENTS + 1) // 2
        self.groups = tuple(
            Group(kind, tap, inside, width if kind in ("mean", "deviation") else pairs)
            for inside in (False, True)
            for tap, width in zip(TAPS, widths, strict=True)
            for kind in TRAITS
        )
        """Of the traits, in their order."""
        self.rule = nn.Linear(sum(group.size for group in self.groups), classes)
        self.register_buffer("known", torch.zeros(classes))
        self.register_buffer("above", torch.triu(torch.ones(COMPONENTS, COMPONENTS)).flatten().nonzero()[:, 0])
        nn.init.zeros_(self.rule.weight)
        nn.init.zeros_(self.rule.bias)

    def traits(self, features: tuple[Tensor, ...]) -> Tensor:
        """(n, all of ``groups``). Of moments the signed root is taken, as is usual, lest the strongest components tell
        everything."""
        taps = (*features, *(_inside(tap) for tap in features))
        moments = torch.stack(
            [texture(tap) for texture, tap in zip((*self.textures, *self.textures), taps, strict=True)], dim=1
        )
        # the roots of all taps at once: many small steps cost the more the more often they are begun
        matrices = torch.cat([torch.sign(moments) * torch.sqrt(torch.abs(moments)), matrix_root(moments[:, :, :1])], dim=2)
        pairs = matrices.flatten(3)[..., self.above].flatten(2)
        found: list[Tensor] = []
        for k, tap in enumerate(taps):
            mean = tap.mean(dim=(2, 3), keepdim=True)
            spread = torch.sqrt(((tap - mean) ** 2).mean(dim=(2, 3)) + 1e-6)
            found.extend((mean[:, :, 0, 0], spread, pairs[:, k]))
        return torch.cat(found, dim=1)

    def forward(self, features: tuple[Tensor, ...]) -> Tensor:
        """The logit (n, classes) of each class, 0 where there is no rule."""
        found: Tensor = self.rule(self.traits(features))
        return found


def _inside(tap: Tensor) -> Tensor:
    """``tap`` (n, channels, h, w) without its border."""
    height, width = int(tap.shape[2]), int(tap.shape[3])
    down, across = height // EDGE[0], width // EDGE[1]
    return tap[:, :, down : height - down, across : width - across]


class Places(nn.Module):
    """Maps of classes that are learnt from where they are (placed.py): of each cell a linear rule, cut to 0..6 and stretched.
    Nothing is learnt here; without a rule a class has no such map."""

    def __init__(self, widths: Sequence[int], classes: int) -> None:
        super().__init__()
        self.taps = nn.ModuleList(nn.Conv2d(width, classes, 1, bias=k == 0) for k, width in enumerate(widths))
        for value in self.parameters():
            nn.init.zeros_(value)
        self.requires_grad_(False)
        self.register_buffer("alone", torch.zeros(classes))
        self.register_buffer("strength", torch.zeros(classes))

    def forward(self, features: tuple[Tensor, ...]) -> Tensor:
        """Anomaly maps (n, classes, h, w), 0 for a class without a rule."""
        return anomaly(GAIN * functional.relu6(_summed(self.taps, features)))


def _summed(convolutions: Iterable[nn.Module], taps: Iterable[Tensor]) -> Tensor:
    """The sum of what each convolution makes of its tap, in the size of the first; the coarse one is enlarged."""
    found: Tensor | None = None
    for convolution, tap in zip(convolutions, taps, strict=True):
        y = convolution(tap)
        if found is None:
            found = y
        else:
            found = found + (
                y if y.shape[2:] == found.shape[2:] else functional.interpolate(y, size=found.shape[2:], mode="bilinear")
            )
    assert found is not None
    return found


class Head(nn.Module):
    """From the features of ``TAPS`` to the maps: every tap is brought to ``hidden`` channels, the coarse one enlarged, their
    sum goes through ReLU6 to one map per class, and that through eq. 8. Its context says whether, the maps say where; what was
    learnt from places says both."""

    def __init__(self, classes: int, hidden: int, dropout: float = 0.0) -> None:
        super().__init__()
        widths = [BLOCKS[tap][3] for tap in TAPS]
        self.scales = nn.ModuleList(nn.BatchNorm2d(width, eps=1e-3, affine=False) for width in widths)
        self.taps = nn.ModuleList(
            nn.Conv2d(width, hidden, 1, bias=tap == TAPS[0]) for tap, width in zip(TAPS, widths, strict=True)
        )
        self.dropout = nn.Dropout2d(dropout)  # whole channels: a 1 x 1 convolution knows nothing else
        self.maps = nn.Conv2d(hidden, classes, 1)
        # at phi = 0 the transformation has no slope to learn from
        nn.init.constant_(self.maps.bias, 0.5)  # type: ignore[arg-type]
        self.context, self.places = Context(widths, classes), Places(widths, classes)

    def forward(self, features: tuple[Tensor, ...]) -> Tensor:
        """Anomaly maps A_k >= 0 (n, classes, h / 16, w / 16), as image-level labels taught them."""
        scaled = (self.dropout(scale(x)) for scale, x in zip(self.scales, features, strict=True))
        return anomaly(self.maps(functional.relu6(_summed(self.taps, scaled))))

    def cut(self, classes: int) -> None:
        """Leave only the first ``classes`` maps. Before anything is learnt from places."""
        maps, rule = nn.Conv2d(self.maps.in_channels, classes, 1), nn.Linear(self.context.rule.in_features, classes)
        for old, new in ((self.maps, maps), (self.context.rule, rule)):
            new.weight = nn.Parameter(old.weight.detach()[:classes])
            new.bias = nn.Parameter(old.bias.detach()[:classes])  # type: ignore[union-attr]
        self.maps, self.context.rule, self.context.known = maps, rule, self.context.known[:classes]
        self.places = Places([int(tap.in_channels) for tap in self.taps], classes)

    def told(self, features: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
        """Maps, and scores (n, classes) in 0..1: by the context where the class has one, else 1 - exp(-z) of its map, eq. 9;
        what was learnt from places is a second, independent witness."""
        maps, placed = self(features) * (1 - self.places.alone[:, None, None]), self.places(features)
        known = self.context.known
        seen = known * torch.sigmoid(self.context(features)) + (1 - known) * (1 - torch.exp(-score(maps)))
        return maps + placed, 1 - (1 - seen) * torch.exp(-self.places.strength * score(placed))

    def fold(self) -> None:
        """Put the scales into what lies behind them: the same maps for less work. Once, after training."""
        for k, (scale, tap) in enumerate(zip(self.scales, self.taps, strict=True)):
            if isinstance(scale, nn.Identity):
                continue
            inverse = torch.rsqrt(scale.running_var + scale.eps)
            weight = tap.weight.detach() * inverse[None, :, None, None]
            shift = -(weight[:, :, 0, 0] @ scale.running_mean)
            folded = nn.Conv2d(weight.shape[1], weight.shape[0], 1)
            folded.weight = nn.Parameter(weight)
            folded.bias = nn.Parameter(shift if tap.bias is None else shift + tap.bias.detach())
            self.taps[k], self.scales[k] = folded, nn.Identity()


class Fcdd(nn.Module):
    """What is taught: the head."""

    def __init__(self, classes: int, hidden: int, dropout: float = 0.0) -> None:
        super().__init__()
        self.head = Head(classes, hidden, dropout)

    def forward(self, features: tuple[Tensor, ...]) -> Tensor:
        """Anomaly maps (n, classes, h / 16, w / 16) from the features of ``TAPS``."""
        found: Tensor = self.head(features)
        return found

    def told(self, features: tuple[Tensor, ...]) -> tuple[Tensor, Tensor]:
        """Maps, and scores (n, classes)."""
        found: tuple[Tensor, Tensor] = self.head.told(features)
        return found


class Whole(nn.Module):
    """Picture to maps and scores, for export: trunk and head."""

    def __init__(self, trunk: Trunk, late: Fcdd) -> None:
        super().__init__()
        self.trunk, self.late = trunk, late

    def forward(self, pictures: Tensor) -> tuple[Tensor, Tensor]:
        """(n, 3, h, w), RGB as (x - 127) / 128, to maps (n, classes, h / 16, w / 16) and scores (n, classes)."""
        found: tuple[Tensor, Tensor] = self.late.told(self.trunk(pictures))
        return found


def anomaly(phi: Tensor) -> Tensor:
    """Eq. 8: the pseudo-Huber transformation of the network's output."""
    return torch.sqrt(phi * phi + 1) - 1


def score(maps: Tensor) -> Tensor:
    """z_ik of eq. 9 (n, classes): the mean of each map."""
    return maps.mean(dim=(2, 3))


def loss(maps: Tensor, labels: Tensor, weights: Tensor) -> Tensor:
    """Eq. 9 with ``weights`` (n, classes): 0 where a label is unknown. ``labels`` (n, classes) in 0..1."""
    z = score(maps)
    present = -torch.log(-torch.expm1(-z.clamp(min=1e-6)))
    each = (1 - labels) * z + labels * present
    return (weights * each).sum() / weights.sum().clamp(min=1e-6)


def merged(heads: list[Head]) -> Head:
    """One head that gives the mean of the outputs phi of several, each trained from another seed: their hidden channels side by
    side. Trunk, scales, context and places must be the same for all."""
    hidden = sum(head.maps.in_channels for head in heads)
    found = Head(heads[0].maps.out_channels, hidden)
    found.scales, found.context, found.places = heads[0].scales, heads[0].context, heads[0].places
    with torch.no_grad():
        for k, tap in enumerate(found.taps):
            tap.weight.copy_(torch.cat([head.taps[k].weight for head in heads]))
            if tap.bias is not None:
                tap.bias.copy_(torch.cat([head.taps[k].bias for head in heads]))
        found.maps.weight.copy_(torch.cat([head.maps.weight for head in heads], dim=1) / len(heads))
        if found.maps.bias is not None:
            found.maps.bias.copy_(torch.stack([head.maps.bias for head in heads]).mean(dim=0))  # type: ignore[arg-type,misc]
    found.eval()
    return found
