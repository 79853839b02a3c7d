"""The published networks from weight files to a bundle that agrees with PyTorch."""

import tomllib

import numpy as np
import onnx
import open_clip
import pytest
import torch

import small
from cosine import least_cosine
from lexsplat_training.command_line import InputError
from lexsplat_training.export import bundle_writer, graphs
from lexsplat_training.export import published as export_published
from lexsplat_training.networks import clip_towers, weights
from lexsplat_training.networks.clip_tokenizer import tokenizer
from lexsplat_training.networks.published import AutoEncoder, Compress
from lexsplat_training.runtime.session import session


@pytest.fixture(scope="module", autouse=True)
def small_towers():
    """The command builds small towers instead of large ones."""
    patch = pytest.MonkeyPatch()
    patch.setattr(clip_towers, "build", lambda _: small.build())
    yield
    patch.undo()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    return folder, small.write_files(folder)


@pytest.fixture(scope="module")
def exported(files, tmp_path_factory):
    """Bundles by kind: one graph, three, and half precision."""
    kinds = {"folded": [], "unfolded": ["--unfolded"], "half": ["--precision", "fp16"]}
    folders = {}
    for kind, more in kinds.items():
        folders[kind] = tmp_path_factory.mktemp(kind)
        out = ["--out", str(folders[kind])]
        export_published.main(small.arguments(files[0], *more, *out))
    return folders


def image(seed=5):
    return np.random.default_rng(seed).normal(size=(1, 3, 64, 96)).astype(np.float32)


def in_torch(files, picture):
    """Codes of an image, by the original modules and not by those that the command loaded."""
    clip, srd, auto_encoder = files[1]
    with torch.inference_mode():
        features = srd(*clip_towers.ConvNextDense(clip.visual)(torch.from_numpy(picture)))
        rows = auto_encoder.encoder(features.permute(0, 2, 3, 1).reshape(-1, small.FEATURE))
        codes = rows / rows.norm(dim=1, keepdim=True)
        return codes.reshape(1, 16, 24, 32).permute(0, 3, 1, 2).numpy()


@pytest.mark.parametrize(
    ("kind", "least"), [("folded", 0.9999), ("unfolded", 0.9999), ("half", 0.999)]
)
def test_onnx_runtime_agrees_with_torch(files, exported, kind, least):
    wanted = in_torch(files, image())
    assert least_cosine(bundle_writer.run(exported[kind], "vision", image()), wanted) > least
    # Negative control: another image, and codes shifted by a pixel.
    other = bundle_writer.run(exported[kind], "vision", image(6))
    assert least_cosine(other, wanted) < 0.98
    assert least_cosine(np.roll(wanted, 1, axis=3), wanted) < 0.98


def test_dense_tower_equals_the_pooled_tower_at_a_single_location():
    clip = small.build()
    picture = torch.from_numpy(image()[:, :, :32, :32])
    with torch.inference_mode():
        dense, middle, fine = clip_towers.ConvNextDense(clip.visual)(picture)
        pooled = clip.encode_image(picture)
        other = clip.encode_image(-picture)
    assert (dense.shape[2:], middle.shape[2:], fine.shape[2:]) == ((1, 1), (4, 4), (8, 8))
    assert least_cosine(dense[:, :, 0, 0], pooled) > 0.99999
    assert least_cosine(dense[:, :, 0, 0], other) < 0.999


def test_folding_removes_one_convolution_and_all_batch_norms(exported):

    nodes = [node.op_type for node in onnx.load(exported["folded"] / "vision.onnx").graph.node]
    names = ("encoder", "srd", "compress")
    graphs = [onnx.load(exported["unfolded"] / f"{name}.onnx").graph for name in names]
    apart = [node.op_type for graph in graphs for node in graph.node]
    assert nodes.count("Conv") == apart.count("Conv") - 1
    assert "BatchNormalization" not in nodes


def test_decoder_and_text_tower_agree_with_torch(files, exported):
    clip, _, auto_encoder = files[1]
    codes = np.random.default_rng(1).normal(size=(7, 32)).astype(np.float32)
    words = tokenizer(77)
    ids = np.array([words.encode("a coffee cup").ids])
    padded = torch.zeros(1, 77, dtype=torch.int64)
    padded[0, : ids.shape[1]] = torch.from_numpy(ids)
    with torch.inference_mode():
        rows = auto_encoder.decoder(torch.from_numpy(codes))
        # open_clip pads texts to the context's length.
        text = clip.encode_text(padded)
    for kind, least in (("folded", 0.9999), ("half", 0.999)):
        found = bundle_writer.run(exported[kind], "decompress", codes)
        assert least_cosine(found, rows) > least
        assert np.abs(np.linalg.norm(found, axis=1) - 1).max() < 1e-3
        assert least_cosine(bundle_writer.run(exported[kind], "text", ids), text) > least
        other = bundle_writer.run(exported[kind], "text", np.array([words.encode("sofa").ids]))
        assert least_cosine(other, text) < 0.99


def test_manifest_matches_the_files(exported):
    for kind, folder in exported.items():
        manifest = tomllib.loads((folder / "manifest.toml").read_text())
        assert set(manifest["sha256"]) | {"manifest.toml"} == {f.name for f in folder.iterdir()}
        assert ("vision" in manifest) == (kind != "unfolded") == ("encoder" not in manifest)
        assert (manifest["image"]["width"], manifest["image"]["height"]) == (96, 64)
        assert manifest["feature_size"] == small.FEATURE
        assert session(folder / "text.onnx").get_outputs()[0].shape[-1] == small.FEATURE


def test_tokenizer_agrees_with_open_clip():

    ours, theirs = tokenizer(77), open_clip.get_tokenizer("ViT-B-32")
    for text in (
        "coffee cup",
        "Where's  the\tBIG red-sofa, 42 cm?",
        "naïve café — ünïcode",
        "日本語",
        "don't",
        "a" * 300,
        "  x ",
        "1,234.5",
        "word " * 100,
    ):
        wanted = theirs([text])[0].tolist()
        assert ours.encode(text).ids == wanted[: wanted.index(49407) + 1], text
    # Negative control: case makes no difference, letters do.
    assert ours.encode("Cup").ids == ours.encode("cup").ids != ours.encode("cap").ids


def changed(files, tmp_path, file, change):
    """Arguments for a copy of the weight files with one of them changed."""
    for source in files[0].iterdir():
        (tmp_path / source.name).write_bytes(source.read_bytes())
    state = torch.load(tmp_path / file, weights_only=True)
    torch.save(change(state), tmp_path / file)
    return small.arguments(tmp_path, "--out", str(tmp_path / "out"))


def without(key):
    def change(state):
        del state["state_dict"][key]
        return state

    return change


def with_tensor(key, tensor):
    def change(state):
        state["state_dict"][key] = tensor
        return state

    return change


@pytest.mark.parametrize(
    ("file", "change", "says"),
    [
        (
            "srd.ckpt",
            without("model.upsample2.0.weight"),
            ["srd.ckpt", "model.upsample2.0.weight", "[512, 256, 4, 4]", "no such tensor"],
        ),
        (
            "srd.ckpt",
            with_tensor("model.final_conv.weight", torch.zeros(32, 128, 1, 1)),
            ["srd.ckpt", "model.final_conv.weight", "[128, 128, 1, 1]", "[32, 128, 1, 1]"],
        ),
        (
            "ae.ckpt",
            with_tensor("model.encoder.0.weight", torch.full((512, 128), torch.nan)),
            ["ae.ckpt", "model.encoder.0.weight", "finite", "NaN"],
        ),
        (
            "ae.ckpt",
            lambda _: {"state_dict": {"fc.weight": torch.zeros(3)}},
            ["ae.ckpt", "auto-encoder", "encoder.0.weight", "fc.weight"],
        ),
        ("ae.ckpt", lambda _: [1, 2], ["ae.ckpt", "tensors by name", "list"]),
        (
            "image.pth",
            lambda state: {
                "model": {
                    name: value for name, value in state["model"].items() if "fc2" not in name
                }
            },
            ["image.pth", "image tower", "fc2.weight", "no such tensor"],
        ),
    ],
)
def test_errors_name_what_does_not_fit(files, tmp_path, file, change, says):
    with pytest.raises(weights.WeightsError) as raised:
        export_published.main(changed(files, tmp_path, file, change))
    for part in says:
        assert part in str(raised.value), (part, str(raised.value))
    assert not (tmp_path / "out" / "manifest.toml").exists()


def test_another_kind_of_tower_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(clip_towers, "build", lambda _: small.build(vision=small.VIT))
    with pytest.raises(InputError, match="--model: expected ConvNeXt"):
        export_published.main(["--random", "1", "--out", str(tmp_path), "--size", "64", "96"])


def test_pickled_module_is_refused_with_advice(tmp_path):
    torch.save(small.Pickled(2, 2), tmp_path / "whole.pth")
    with pytest.raises(weights.WeightsError, match=r"whole.pth.*state dict"):
        weights.read(tmp_path / "whole.pth")
    whole = torch.zeros(2, 2)
    torch.save({"weight": whole}, tmp_path / "plain.pth")
    assert weights.read(tmp_path / "plain.pth")["weight"].equal(whole)
    cut = (tmp_path / "plain.pth").read_bytes()[:300]
    (tmp_path / "cut.pth").write_bytes(cut)
    for name, says in (("cut.pth", "cut off"), ("none.pth", "no such file")):
        with pytest.raises(weights.WeightsError, match=rf"{name}.*{says}"):
            weights.read(tmp_path / name)


def test_export_that_disagrees_with_torch_is_refused(tmp_path):
    torch.manual_seed(4)
    module = Compress(small.scattered(AutoEncoder(small.FEATURE))).eval()
    features = torch.randn(1, small.FEATURE, 4, 4)

    model = graphs.export(module, (features,), ["features"], ["codes"])
    onnx.save(model, tmp_path / "compress.onnx")
    with torch.inference_mode():
        bundle_writer.check(tmp_path, "fp32", "compress", module, features)
        module.layers[0].bias += 0.5
        with pytest.raises(ValueError, match=r"compress.onnx.*cosine.*0.9999"):
            bundle_writer.check(tmp_path, "fp32", "compress", module, features)
