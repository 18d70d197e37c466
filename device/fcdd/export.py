"""From trained weights to one ONNX file that says itself what it is: float32 arithmetic with weights in 16 bits, or int8."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from estimators.fcdd import ModelCard

if TYPE_CHECKING:
    from estimators.fcdd_training.network import Whole

OPSET = 17
"""onnxruntime on aarch64 has run it since 1.12."""
_SMALL = 256
"""Constants with no more numbers than this stay in 32 bits."""


def float_model(network: Whole, card: ModelCard) -> bytes:
    """The network as it was trained. Its weights lie in the file in 16 bits, which costs less than a thousandth of a score and
    halves the file; onnxruntime turns them back once, when it loads them."""
    import onnx

    model = _traced(network, card)
    _keep_in_half(model)
    _sign(model, card)
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


def int8_model(network: Whole, card: ModelCard, inputs: Iterable[NDArray[np.float32]]) -> bytes:
    """Static int8 (QDQ), calibrated on ``inputs`` (1, 3, h, w). The head keeps its 32 bits: it is small, and eq. 8 is not
    linear."""
    import onnx
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.shape_inference import quant_pre_process

    class Reader(CalibrationDataReader):  # type: ignore[misc,unused-ignore]
        def __init__(self) -> None:
            self._rows = iter(inputs)

        def get_next(self) -> dict[str, Any] | None:
            row = next(self._rows, None)
            return None if row is None else {"picture": row}

    with tempfile.TemporaryDirectory() as folder:
        plain, ready, done = (Path(folder) / name for name in ("plain.onnx", "ready.onnx", "done.onnx"))
        model = _traced(network, card)
        onnx.save(model, str(plain))
        quant_pre_process(str(plain), str(ready), skip_symbolic_shape=True)
        head = [node.name for node in onnx.load(str(ready)).graph.node if not node.name.startswith("/trunk/")]
        quantize_static(
            str(ready),
            str(done),
            Reader(),
            quant_format=QuantFormat.QDQ,
            per_channel=True,
            activation_type=QuantType.QUInt8,
            weight_type=QuantType.QInt8,
            nodes_to_exclude=head,
        )
        model = onnx.load(str(done))
    _sign(model, card)
    return bytes(model.SerializeToString())


def _traced(network: Whole, card: ModelCard) -> Any:
    import onnx
    import torch

    network.eval()
    network.late.head.fold()
    width, height = card.size
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "model.onnx"
        torch.onnx.export(
            network,
            (torch.zeros(1, 3, height, width),),
            str(file),
            input_names=["picture"],
            output_names=["maps", "scores"],
            opset_version=OPSET,
            dynamo=False,
        )
        return onnx.load(str(file))


def _keep_in_half(model: Any) -> None:
    from onnx import TensorProto, helper, numpy_helper

    casts = []
    for constant in model.graph.initializer:
        if constant.data_type != TensorProto.FLOAT:
            continue
        values = numpy_helper.to_array(constant)
        if values.size <= _SMALL or np.abs(values).max() > 6e4:
            continue
        name = constant.name
        constant.CopyFrom(numpy_helper.from_array(values.astype(np.float16), name + "_half"))
        casts.append(helper.make_node("Cast", [name + "_half"], [name], to=TensorProto.FLOAT))
    for number, cast in enumerate(casts):
        model.graph.node.insert(number, cast)


def _sign(model: Any, card: ModelCard) -> None:
    from onnx import helper

    del model.metadata_props[:]
    helper.set_model_props(model, card.metadata())
    model.producer_name = "borescout"
