"""The steps of ``borescout fcdd train``: features of every version of every picture, folds, thresholds, the network for good.

Every step leaves its result in the work folder, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid
from device.fcdd.archive import SHIPPED_CLASSES, ClassFile, read_archive, read_boxes, read_picture
from device.fcdd.features import BORDER, CLOSER, SIZE, Versions, features_of, pretrained, trunk_model
from device.fcdd.lessons import PLACED, Lesson, lessons_of, rendered_lessons, taught_names
from device.fcdd.places import learn_places
from estimators.fcdd import ModelCard, prepared
from estimators.fcdd_training.folds import auroc, grouped_folds, threshold_for

if TYPE_CHECKING:
    from torch import Tensor

    from estimators.fcdd_training.context import Telling
    from estimators.fcdd_training.network import Context, Fcdd
    from estimators.fcdd_training.training import Material

SHARES = {"stills": 0.7, "boxes": 0.1, "rendered": 0.2}
"""How often each kind of picture is drawn for training the maps."""
CONTEXT_SHARES = {"stills": 0.9, "boxes": 0.1, "rendered": 0.1}
"""How much each kind counts for the context: with none, the rule tells nothing of a rendered pipe."""
CALIBRATION = 64
"""Pictures that int8 is calibrated on."""
MAP_SHARE = 0.9
"""A map's threshold: what so many of the cells of pictures of the class stay below."""
Note = Callable[[str], None]


@dataclass(frozen=True)
class Wanted:
    """What ``borescout fcdd train`` was asked for."""

    data: Path
    out: Path
    work: Path
    boxes: Path | None = None
    classes: ClassFile = field(default_factory=lambda: SHIPPED_CLASSES)
    rendered: int = 70
    versions: int = 18
    rendered_versions: int = 2
    steps: int = 60
    seeds: int = 1
    folds: int = 5
    by: str = "cluster"
    precision: float = 0.7
    as_int8: bool = False
    seed: int = 1
    told_by: Telling | None = None
    """By what every class is told, all alike; None for each class its own."""

    def recipe(self) -> str:
        """A name for what scores depend on."""
        from estimators.fcdd_training.context import TOLD_BY, USUAL
        from estimators.fcdd_training.network import BROAD, EDGE, NEWTON

        told = (
            *(USUAL, TOLD_BY, EDGE, BROAD, BORDER, NEWTON, CONTEXT_SHARES, PLACED, self.classes.names),
            None if self.boxes is None else self.boxes.name,
            *(self.rendered, self.versions, self.rendered_versions, self.folds, self.seed),
            self.told_by,
        )
        return f"{self.by}_{hashlib.sha256(repr(told).encode()).hexdigest()[:10]}"


@dataclass(frozen=True)
class School:
    """Everything that training needs. ``names`` are the classes and what is learnt beside them."""

    wanted: Wanted
    lessons: list[Lesson]
    names: tuple[str, ...]
    material: Material
    pretrained: dict[str, Tensor]

    def context(self, rows: NDArray[np.int64]) -> Context:
        """Fitted on ``rows``."""
        from estimators.fcdd_training.context import fit_context, measure_textures
        from estimators.fcdd_training.network import Fcdd

        found = Fcdd(len(self.names), 1).head.context
        kinds = [lesson.kind for lesson in self.lessons]
        shares = np.array([CONTEXT_SHARES[kind] / kinds.count(kind) for kind in kinds], np.float32)
        measure_textures(found, self.material, rows[np.array([kinds[row] != "rendered" for row in rows])])
        # what is learnt from places in rendered pictures is learnt from those alone: of the rest they are only without it
        weights = self.material.weights.copy()
        for column in (self.names.index(label) for label in PLACED if label in self.names):
            weights[np.array([kind == "rendered" for kind in kinds]) & (self.material.labels[:, column] > 0), column] = 0
        material = replace(self.material, weights=weights)
        fit_context(found, material, shares, rows, self.wanted.classes.names, self.wanted.told_by)
        return found

    def network(self, note: Note) -> Fcdd:
        """Maps and context, taught with everything; of ``seeds`` heads one is made."""
        from estimators.fcdd_training.network import merged
        from estimators.fcdd_training.training import TrainConfig, fit

        def tell(seed: int) -> Callable[[int, float], None]:
            return lambda step, value: note(f"head {seed + 1}, step {step}, loss {value:.3f}") if step % 20 == 0 else None

        rows = np.arange(len(self.lessons))
        config = TrainConfig(steps=self.wanted.steps)
        nets = [fit(self.material, rows, config, seed, tell(seed)) for seed in range(self.wanted.seeds)]
        net = nets[0]
        net.head = merged([one.head for one in nets])
        net.head.context = self.context(rows)
        return net


def school_of(wanted: Wanted, note: Note) -> School:
    """Pictures and features, from disk or made. Raises Invalid."""
    weights = pretrained()

    import torch

    torch.set_num_threads(1)
    wanted.work.mkdir(parents=True, exist_ok=True)
    trunk = trunk_model(weights, wanted.work)
    names = taught_names(wanted.classes.names)
    parts = [lessons_of(read_archive(wanted.data, wanted.classes), names)]
    if wanted.boxes is not None:
        parts.append(lessons_of(read_boxes(wanted.boxes), names, "boxes"))
    if wanted.rendered:
        parts.append(rendered_lessons(wanted.rendered, wanted.seed, names, wanted.work))
        note(f"{len(parts[-1])} pictures of the virtual sewer")
    seen, closer = [], []
    for part in parts:
        kind = part[0].kind
        count = wanted.rendered_versions if kind == "rendered" else wanted.versions
        seen.append(features_of(part, range(count), trunk, wanted.work, kind, wanted.seed, note))
        closer.append(features_of(part, CLOSER, trunk, wanted.work, kind, wanted.seed, note))
    lessons = [lesson for part in parts for lesson in part]
    taps, inside = (tuple(Versions(tuple(found)) for found in zip(*each, strict=True)) for each in (seen, closer))
    material = material_of(lessons, taps, inside, wanted.classes.names)
    return School(wanted, lessons, names, material, weights)


def material_of(
    lessons: list[Lesson], taps: tuple[Versions, ...], closer: tuple[Versions, ...], classes: tuple[str, ...]
) -> Material:
    """What ``fit`` takes. Within each kind of picture all classes are drawn alike."""
    from estimators.fcdd_training.training import Material, fair_share

    labels = np.stack([lesson.labels for lesson in lessons])
    weights = np.stack([lesson.weights for lesson in lessons])
    share = np.zeros(len(lessons))
    for kind, part in SHARES.items():
        rows = np.flatnonzero([lesson.kind == kind for lesson in lessons])
        if len(rows):
            share[rows] = part * fair_share(labels[rows][:, : len(classes)] > 0, [lessons[k].group for k in rows])
    return Material(taps, labels, weights, share / share.sum(), closer)


def out_of_fold(school: School, note: Note) -> NDArray[np.float64]:
    """Scores (n, classes) in 0..1 of every picture from contexts that saw none of its ``by`` ("cluster" or "collection") and
    no near duplicate of it: the mean of the plain and the mirrored picture. Each fold is kept in the work folder."""
    import torch

    from estimators.fcdd_training.context import traits_of

    wanted, lessons, material = school.wanted, school.lessons, school.material
    count = len(wanted.classes.names)
    clusters = np.array([lesson.group for lesson in lessons])
    groups = [lesson.group if wanted.by == "cluster" or lesson.kind != "stills" else lesson.source for lesson in lessons]
    fold = _folds(lessons, groups, material.labels[:, :count], wanted.folds)
    found = np.zeros((len(lessons), count))
    for k in range(wanted.folds):
        test = np.flatnonzero(fold == k)
        train = np.flatnonzero((fold != k) & ~np.isin(clusters, clusters[test]))
        file = wanted.work / f"scores_{wanted.recipe()}_{k}.npy"
        if not file.exists():
            context = school.context(train)
            with torch.no_grad():
                told = torch.sigmoid(context.rule(torch.from_numpy(traits_of(context, material.features, test)))).mean(dim=0)
            np.save(file, told[:, :count].numpy())
            note(f"fold {k + 1} of {wanted.folds} by {wanted.by}")
        found[test] = np.load(file)
    return found


def _folds(lessons: list[Lesson], groups: list[str], labels: NDArray[np.float32], count: int) -> NDArray[np.int64]:
    """Every kind of picture is split by itself, so that stills lie in the same folds whatever is learnt beside them."""
    fold = np.zeros(len(lessons), np.int64)
    for kind in SHARES:
        rows = np.flatnonzero([lesson.kind == kind for lesson in lessons])
        if len(rows):
            fold[rows] = grouped_folds([groups[k] for k in rows], labels[rows], count, np.random.default_rng(0))
    return fold


def score_thresholds(scores: NDArray[np.float64], school: School) -> dict[str, float]:
    """Per class the threshold of the score that gives the wanted precision on out-of-fold scores: of stills, and where none
    has the class, of rendered pictures."""
    labels = school.material.labels
    stills = np.array([lesson.kind == "stills" for lesson in school.lessons])
    rendered = np.array([lesson.kind == "rendered" for lesson in school.lessons])
    found = {}
    for k, name in enumerate(school.wanted.classes.names):
        rows = stills if labels[stills, k].any() else rendered
        if not labels[rows, k].any():
            found[name] = 0.5
            continue
        found[name] = threshold_for(scores[rows, k], labels[rows, k] > 0, school.wanted.precision)
    return found


def map_thresholds(net: Fcdd, school: School) -> dict[str, float]:
    """Per class the threshold of the anomaly map."""
    import torch

    found = {}
    plain = [tap[0] for tap in school.material.features]
    for k, name in enumerate(school.wanted.classes.names):
        rows = np.flatnonzero(school.material.labels[:, k] > 0)
        if len(rows) == 0:
            found[name] = 1.0
            continue
        with torch.no_grad():
            maps = net(tuple(torch.from_numpy(tap[rows].astype(np.float32)) for tap in plain))
        found[name] = float(np.quantile(maps[:, k].numpy(), MAP_SHARE))
    return found


def train_scores(wanted: Wanted, note: Note) -> tuple[list[Lesson], NDArray[np.float64]]:
    """The pictures with their out-of-fold scores (n, classes), for benchmarks. Raises Invalid."""
    school = school_of(wanted, note)
    return school.lessons, out_of_fold(school, note)


def train_model(wanted: Wanted, note: Note) -> dict[str, float | None]:
    """The whole way from labelled pictures to a model file. Returns the out-of-fold AUROC of each class on stills, None
    where none has it. Raises Invalid."""
    school = school_of(wanted, note)

    import torch

    names, lessons, material = wanted.classes.names, school.lessons, school.material
    scores = out_of_fold(school, note)
    net = school.network(note)
    net.head.cut(len(names))
    thresholds, heights = score_thresholds(scores, school), map_thresholds(net, school)
    for label in sorted(set(PLACED) & set(names)):
        column = names.index(label)
        real = any(lesson.kind != "rendered" and lesson.labels[column] > 0 for lesson in lessons)
        placed = learn_places(net, lessons, material, column, label, thresholds[label] if real else None, note)
        if placed is not None:
            thresholds[label] = placed[0]
            heights[label] = heights[label] if real else placed[1]
    stills = np.array([lesson.kind == "stills" for lesson in lessons])
    labels = material.labels[:, : len(names)] > 0
    found = {
        name: round(auroc(scores[stills, k], labels[stills, k]), 4) if labels[stills, k].any() else None
        for k, name in enumerate(names)
    }
    about = {kind: str(sum(lesson.kind == kind for lesson in lessons)) for kind in SHARES}
    card = ModelCard(
        names, SIZE, _rounded(thresholds), _rounded(heights), {**about, "auroc": json.dumps(found), "split": wanted.by}
    )
    kept = {
        "head": net.head.state_dict(),
        "hidden": net.head.maps.in_channels,
        "card": card.metadata(),
    }
    torch.save(kept, wanted.work / "weights.pt")
    export_weights(wanted.work / "weights.pt", wanted.out, wanted.data if wanted.as_int8 else None)
    return found


def export_weights(file: Path, out: Path, calibrate: Path | None) -> float:
    """A model from ``weights.pt``; int8 where there are pictures to ``calibrate`` on. Returns the largest difference of a
    score from torch on some pictures made of noise and shapes. Raises Invalid."""
    import torch

    from device.fcdd.export import float_model, int8_model
    from estimators.fcdd import Fcdd as Runtime
    from estimators.fcdd import card_of
    from estimators.fcdd_training.network import Fcdd, Trunk, Whole

    try:
        kept = torch.load(file, map_location="cpu", weights_only=True)
        card = card_of(kept["card"])
        late = Fcdd(len(card.classes), int(kept["hidden"]))
        late.head.load_state_dict(kept["head"])
    except FileNotFoundError:
        raise Invalid(f"There are no weights {file}.") from None
    except (OSError, KeyError, ValueError, RuntimeError, pickle.UnpicklingError):
        raise Invalid(f"The file {file} holds no weights of a training.") from None
    trunk = Trunk()
    trunk.load(pretrained())
    whole = Whole(trunk, late).eval()
    tried = _trials(card.size)
    with torch.no_grad():
        expected = [whole(torch.from_numpy(x))[1][0].numpy() for x in tried]
    if calibrate is None:
        model = float_model(whole, card)
    else:
        stills = read_archive(calibrate)
        chosen = np.random.default_rng(1).permutation(len(stills))[:CALIBRATION]
        model = int8_model(whole, card, (prepared(read_picture(stills[k]), card.size) for k in chosen))
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(model)
    runtime = Runtime(model)
    found = [runtime.run(x)[1] for x in tried]
    return float(np.abs(np.array(found) - np.array(expected)).max())


def _rounded(values: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 5) for name, value in values.items()}


def _trials(size: tuple[int, int]) -> list[NDArray[np.float32]]:
    rng = np.random.default_rng(7)
    pictures = []
    for _ in range(6):
        picture = rng.integers(0, 255, (size[1] // 16, size[0] // 16, 3)).astype(np.uint8)
        pictures.append(np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC), np.uint8))
    return [prepared(picture, size) for picture in pictures]
