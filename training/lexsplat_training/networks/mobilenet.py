"""MobileNetV2, with weights read from an int8 TFLite classifier (ImageNet, 1001 classes)."""

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

# expansion, output channels, repeats, stride of the first repeat
BLOCKS = [
    (1, 16, 1, 1),
    (6, 24, 2, 2),
    (6, 32, 3, 2),
    (6, 64, 4, 2),
    (6, 96, 3, 1),
    (6, 160, 3, 2),
    (6, 320, 1, 1),
]


class Convolution(nn.Conv2d):
    """A convolution that trains fast on a CPU with bf16 matrix units.

    In training, 1x1 kernels are matrix products (bf16 under autocast) and all others run in fp32.
    In evaluation, and so in exported graphs, it is a plain convolution.
    """

    def forward(self, x):
        if not self.training:
            return super().forward(x)
        if self.kernel_size == (1, 1):
            weight = self.weight[:, :, 0, 0]
            return F.linear(x.permute(0, 2, 3, 1), weight, self.bias).permute(0, 3, 1, 2)
        with torch.autocast("cpu", enabled=False):
            return super().forward(x.float())


class Conv(nn.Module):
    """A convolution with TensorFlow's "same" padding and an optional ReLU6.

    With stride 2 and an even size, there is one row more at the bottom and one column more on the
    right.
    """

    def __init__(self, inputs, outputs, size=1, stride=1, groups=1, act=True):
        super().__init__()
        padding = size // 2 if stride == 1 else 0
        self.conv = Convolution(inputs, outputs, size, stride, padding, groups=groups)
        self.act = act

    def forward(self, x):
        if self.conv.stride[0] == 2:
            less = self.conv.kernel_size[0] // 2 - 1
            x = F.pad(x, (less, less + 1, less, less + 1))
        x = self.conv(x)
        return F.relu6(x) if self.act else x


class Block(nn.Module):
    """Inverted residual: expand, depthwise, project."""

    def __init__(self, inputs, outputs, expansion, stride, size=3):
        super().__init__()
        inner = inputs * expansion
        self.expand = Conv(inputs, inner) if expansion > 1 else nn.Identity()
        self.depthwise = Conv(inner, inner, size, stride, groups=inner)
        self.project = Conv(inner, outputs, act=False)
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x):
        y = self.project(self.depthwise(self.expand(x)))
        return x + y if self.residual else y


class MobileNet(nn.Module):
    """RGB in -1..1 -> maps at stride 4 (24 channels), 8 (32), 16 (96) and 32 (1280)."""

    def __init__(self):
        super().__init__()
        self.stem = Conv(3, 32, 3, 2)
        blocks, channels = [], 32
        for expansion, outputs, repeats, stride in BLOCKS:
            for repeat in range(repeats):
                blocks.append(Block(channels, outputs, expansion, stride if repeat == 0 else 1))
                channels = outputs
        self.blocks = nn.ModuleList(blocks)
        self.head = Conv(320, 1280)

    def early(self, x):
        """The maps at stride 4 and 8. Training leaves these blocks as they are."""
        x = self.stem(x)
        for block in self.blocks[:3]:
            x = block(x)
        skip4 = x
        for block in self.blocks[3:6]:
            x = block(x)
        return skip4, x

    def late(self, x):
        """The maps at stride 16 and 32, from the one at stride 8."""
        for block in self.blocks[6:13]:
            x = block(x)
        middle = x
        for block in self.blocks[13:]:
            x = block(x)
        return middle, self.head(x)

    def forward(self, x):
        skip4, skip8 = self.early(x)
        return skip4, skip8, *self.late(skip8)


def read_convolutions(path):
    """(weight [out, in/groups, k, k], bias) of each convolution, in graph order, dequantised."""
    from ai_edge_litert.interpreter import Interpreter

    interpreter = Interpreter(str(path))
    interpreter.allocate_tensors()
    details = {d["index"]: d for d in interpreter.get_tensor_details()}

    def dequantise(index):
        parameters = details[index]["quantization_parameters"]
        values = interpreter.get_tensor(index).astype(np.float32)
        shape = [1] * values.ndim
        if len(parameters["scales"]) > 1:
            shape[parameters["quantized_dimension"]] = -1
        zero = parameters["zero_points"].reshape(shape) if len(parameters["zero_points"]) else 0
        return ((values - zero) * parameters["scales"].reshape(shape)).astype(np.float32)

    for op in interpreter._get_ops_details():  # litert offers no public list of operators
        if op["op_name"] not in ("CONV_2D", "DEPTHWISE_CONV_2D"):
            continue
        weight, bias = dequantise(op["inputs"][1]), dequantise(op["inputs"][2])
        axes = (3, 0, 1, 2) if op["op_name"] == "DEPTHWISE_CONV_2D" else (0, 3, 1, 2)
        yield torch.from_numpy(weight.transpose(axes).copy()), torch.from_numpy(bias)


def load_mobilenet(path):
    """(MobileNet, classifier weight [1001, 1280]) of a TFLite file."""
    net = MobileNet()
    *features, (weight, _) = read_convolutions(path)
    convolutions = [m for m in net.modules() if isinstance(m, nn.Conv2d)]
    for module, (w, b) in zip(convolutions, features, strict=True):
        module.weight.data.copy_(w)
        module.bias.data.copy_(b)
    return net, weight[:, :, 0, 0]
