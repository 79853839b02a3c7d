"""ONNX Runtime sessions on the CPU."""

import onnxruntime


def session(model):
    """A session on two threads; `model`: a path, or the bytes of a model."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 2
    options.log_severity_level = 3
    source = model if isinstance(model, bytes) else str(model)
    return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])


def run(model, values):
    """All outputs of a model for its inputs in order."""
    loaded = session(model)
    names = [value.name for value in loaded.get_inputs()]
    return loaded.run(None, dict(zip(names, values, strict=True)))
