"""Two image encoders joined to one graph compute what both compute alone."""

import numpy as np
import torch

from lexsplat_training.export import graphs, pair
from lexsplat_training.networks.efficientnet import EPSILON, EfficientNet, folded
from lexsplat_training.networks.encoder import Encoder
from lexsplat_training.networks.second_encoder import SIZES, Head, SecondEncoder, surroundings
from lexsplat_training.networks.super_resolution import SuperResolution


def test_joined_graphs_equal_both_encoders(tmp_path, monkeypatch):
    torch.manual_seed(1)
    first, second = tmp_path / "first", SecondEncoder(EfficientNet(), Head()).eval()
    first.mkdir()
    graphs.export_encoder(Encoder(), SuperResolution(), first)
    assert pair.write(first, second, tmp_path / "pair") > 0.9999
    # Negative control: the same graphs compared with another weight of the second encoder.
    monkeypatch.setattr(pair, "WEIGHT", 0.0)
    assert pair.compare(tmp_path / "pair", first, second) < 0.99


def test_folded_batch_norm_changes_nothing():
    torch.manual_seed(2)
    convolution = torch.nn.Conv2d(3, 4, 3, bias=False)
    norm = torch.nn.BatchNorm2d(4, eps=EPSILON)
    for values in (norm.weight.data, norm.bias.data, norm.running_mean, norm.running_var):
        values.uniform_(0.5, 2)
    state = {f"c.{key}": value for key, value in convolution.state_dict().items()}
    state |= {f"n.{key}": value for key, value in norm.state_dict().items()}
    image = torch.randn(1, 3, 8, 8)
    with torch.inference_mode():
        wanted = norm.eval()(convolution(image))
        weight, bias = folded("c", "n", state)
        found = torch.nn.functional.conv2d(image, weight, bias)
        unfolded = convolution(image)
    assert (found - wanted).abs().max() < 1e-5
    assert (unfolded - wanted).abs().max() > 0.1  # negative control


def test_points_and_maps_have_the_same_features():
    torch.manual_seed(3)
    head = Head().eval()
    maps = [torch.randn(1, c, 8 // s, 8 // s) for c, s in ((48, 1), (120, 2), (1280, 4))]
    # Where coarse maps are constant, enlarging them changes nothing.
    maps[1], maps[2] = (m.mean((2, 3), keepdim=True).expand_as(m) for m in maps[1:])
    with torch.inference_mode():
        dense = head(*maps)[0, :, 3, 5].numpy()
        around = [m[:, :, 3 * m.shape[2] // 8, 5 * m.shape[3] // 8] for m in surroundings(*maps)]
        rows, scene = torch.cat(around, 1), maps[2].mean((2, 3))
        point = head.at_points(rows, scene)[0].numpy()
        other = head.at_points(rows, -scene)[0].numpy()
    assert rows.shape[1] == sum(SIZES)
    assert np.abs(dense - point).max() < 1e-4
    assert np.abs(dense - other).max() > 1e-3  # negative control: another scene
