"""A folded graph computes the same as its parts, with fewer nodes."""

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import helper, numpy_helper

from cosine import least_cosine
from lexsplat_training.export import folding
from lexsplat_training.runtime.session import session

TINY = Path(__file__).parent.parent.parent / "models" / "tiny"
RANDOM = np.random.default_rng(3)


def weight(name, *shape):
    return numpy_helper.from_array(RANDOM.normal(size=shape).astype(np.float32), name)


def model(nodes, weights, inputs, outputs):
    info = [
        [helper.make_tensor_value_info(name, 1, shape) for name, shape in values.items()]
        for values in (inputs, outputs)
    ]
    graph = helper.make_graph(nodes, "part", *info, weights)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)


def parts():
    """Two graphs: ConvTranspose, BN, ReLU, 1x1; and 1x1 with fp16 weights, BN, ReLU, 1x1."""
    node = helper.make_node
    variance = numpy_helper.from_array(np.float32([0.5, 1.5, 2.5, 0.1]), "var")
    first = model(
        [
            node("ConvTranspose", ["image", "w0"], ["a"], strides=[2, 2], kernel_shape=[2, 2]),
            node("BatchNormalization", ["a", "s", "t", "m", "var"], ["b"], epsilon=1e-3),
            node("Relu", ["b"], ["c"]),
            node("Conv", ["c", "w1", "b1"], ["d"]),
            node("Identity", ["d"], ["dense"]),
        ],
        [
            weight("w0", 3, 4, 2, 2),
            weight("s", 4),
            weight("t", 4),
            weight("m", 4),
            variance,
            weight("w1", 9, 4, 1, 1),
            weight("b1", 9),
        ],
        {"image": [1, 3, 5, 6]},
        {"dense": [1, 9, 10, 12]},
    )
    half = numpy_helper.from_array(RANDOM.normal(size=(4, 9, 1, 1)).astype(np.float16), "half")
    second = model(
        [
            node("Cast", ["half"], ["w2"], to=1),
            node("Conv", ["dense", "w2", "b2"], ["e"]),
            node("BatchNormalization", ["e", "s", "t", "m", "var"], ["f"]),
            node("Relu", ["f"], ["g"]),
            node("Conv", ["g", "w3"], ["out"]),
        ],
        [
            half,
            weight("b2", 4),
            weight("s", 4),
            weight("t", 4),
            weight("m", 4),
            variance,
            weight("w3", 2, 4, 1, 1),
        ],
        {"dense": [1, 9, 10, 12]},
        {"out": [1, 2, 10, 12]},
    )
    return first, second


def in_a_row(first, second, image):
    dense = session(first.SerializeToString()).run(None, {"image": image})[0]
    return session(second.SerializeToString()).run(None, {"dense": dense})[0]


def test_batch_norms_and_1x1_convolutions_fold_into_convolutions():
    first, second = parts()
    folded = folding.fold(
        [first, second], [{"dense": "dense"}], {"image": "image"}, {"out": "codes"}
    )
    # ConvTranspose with its BN, the two 1x1 with theirs, the last 1x1; two ReLU between.
    assert [node.op_type for node in folded.graph.node] == [
        "ConvTranspose",
        "Relu",
        "Conv",
        "Relu",
        "Conv",
    ]
    image = RANDOM.normal(size=(1, 3, 5, 6)).astype(np.float32)
    wanted = in_a_row(first, second, image)
    found = session(folded.SerializeToString()).run(["codes"], {"image": image})[0]
    assert np.abs(found - wanted).max() < 1e-4 * np.abs(wanted).max()
    # Negative control: another mean in the batch norm changes the result.
    other = numpy_helper.from_array(np.zeros(4, np.float32), "m")
    first.graph.initializer[3].CopyFrom(other)
    assert np.abs(found - in_a_row(first, second, image)).max() > 1e-2 * np.abs(wanted).max()


def test_folding_that_costs_more_or_breaks_another_reader_is_left_out():
    node = helper.make_node
    # 64 -> 2 -> 64: one matrix of 64x64 would cost 16 times as much.
    narrow = model(
        [node("Conv", ["image", "w0"], ["a"]), node("Conv", ["a", "w1"], ["b"])],
        [weight("w0", 2, 64, 1, 1), weight("w1", 64, 2, 1, 1)],
        {"image": [1, 64, 3, 3]},
        {"b": [1, 64, 3, 3]},
    )
    assert len(folding.simplified(narrow).graph.node) == 2
    twice = model(
        [
            node("Conv", ["image", "w0"], ["a"]),
            node("Conv", ["a", "w1"], ["b"]),
            node("Add", ["a", "b"], ["c"]),
        ],
        [weight("w0", 4, 4, 1, 1), weight("w1", 4, 4, 1, 1)],
        {"image": [1, 4, 3, 3]},
        {"c": [1, 4, 3, 3]},
    )
    assert len(folding.simplified(twice).graph.node) == 3


def test_links_must_fit_the_graphs():
    first, second = parts()
    with pytest.raises(ValueError, match="links: expected one less than graphs"):
        folding.fold([first, second], [], {"image": "image"}, {"out": "codes"})
    with pytest.raises(ValueError, match="nothing"):
        folding.fold([first, second], [{"dense": "nothing"}], {"image": "image"}, {"out": "codes"})


def test_folded_tiny_bundle_computes_the_same_codes():
    folded = folding.fold_bundle(TINY)
    onnx.checker.check_model(folded, full_check=True)
    image = RANDOM.normal(size=(1, 3, 288, 384)).astype(np.float32)
    outputs = session(TINY / "encoder.onnx").run(["coarse", "skip8", "skip4"], {"image": image})
    inputs = dict(zip(["coarse", "skip8", "skip4"], outputs, strict=True))
    features = session(TINY / "srd.onnx").run(["features"], inputs)[0]
    wanted = session(TINY / "compress.onnx").run(["codes"], {"features": features})[0]
    one = session(folded.SerializeToString())
    assert [value.name for value in one.get_inputs()] == ["image"]
    found = one.run(["codes"], {"image": image})[0]
    assert found.shape == (1, 32, 72, 96)
    assert least_cosine(found, wanted) > 0.9999
    # Negative control: the codes of another image.
    other = one.run(["codes"], {"image": -image})[0]
    assert least_cosine(other, wanted) < 0.99
