"""`bundle` from nothing against a hub on loopback, for every name of the catalogue.

The hub serves small networks of the same architectures with random weights. Scores say nothing
then; what counts is that the graphs compute what the networks do.
"""

import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from tokenizers import Tokenizer

import random_hub
import small
from cosine import least_cosine
from hub import Fault, Hub
from lexsplat_training.bundles import catalogue, command, from_siglip, rooms
from lexsplat_training.command_line import InputError
from lexsplat_training.export import surgery
from lexsplat_training.networks import clip_towers, talk2dino
from lexsplat_training.runtime import session
from lexsplat_training.runtime.bundle import Bundle

SIZES = {"openclip": (64, 96), "siglip2": (96, 96), "talk2dino": (70, 98), "paper": (64, 96)}
GRIDS = {"openclip": (4, 6), "siglip2": (6, 6), "talk2dino": (5, 7), "paper": (16, 24)}
NAMES = list(SIZES)
RENDERER = Path(__file__).with_name("boxes.py")


def shrunk(entry):
    """An entry for small images."""
    entry.options["size"] = SIZES[entry.name]
    return entry


@pytest.fixture(scope="module", autouse=True)
def small_networks():
    """The commands build small networks for small images."""
    patch, entries = pytest.MonkeyPatch(), catalogue.read()

    def towers(name):
        return small.build(small.CONVNEXT if name.startswith("convnext") else small.VIT)

    patch.setattr(clip_towers, "build", towers)
    patch.setattr(talk2dino, "build", random_hub.small_talk2dino)
    patch.setattr(catalogue, "entry", lambda name: shrunk(entries[name]))
    yield
    patch.undo()


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a hub's files, a program that renders rooms, and all that is made."""
    folder = tmp_path_factory.mktemp("bundle")
    for name in NAMES:
        random_hub.write(folder / "hub", catalogue.entry(name))
    program = folder / "lexsplat"
    program.write_text(f"#!{sys.executable}\n{RENDERER.read_text()}")
    program.chmod(0o755)
    return folder


def make(place, name, hub, *more):
    """Runs the command; returns the bundle's folder."""
    out = place / "models" / name
    options = {"hub": hub.address, "lexsplat": place / "lexsplat", "cache": place / "cache"}
    options |= {"lock": place / "lock", "out": out}
    line = [part for key, value in options.items() for part in (f"--{key}", str(value))]
    command.main([name, "--accept-licence", *line, *more])
    return out


@pytest.fixture(scope="module")
def made(place):
    """All bundles; the hub breaks one connection of each off and is busy once."""
    folders = {}
    with Hub(place / "hub") as hub:
        for name in NAMES:
            for source in catalogue.entry(name).files.values():
                hub.faults[Path(source.names[0]).name] = [Fault(cut=900), Fault(status=503)]
            folders[name] = make(place, name, hub)
    return folders


@pytest.fixture(autouse=True, scope="module")
def no_pauses():
    patch = pytest.MonkeyPatch()
    patch.setattr("lexsplat_training.bundles.download.time.sleep", lambda _: None)
    yield
    patch.undo()


def picture(name, seed=5):
    shape = (1, 3, *SIZES[name])
    return np.random.default_rng(seed).normal(size=shape).astype(np.float32)


def in_torch(place, name, image):
    """Features of an image by the networks that the hub's files were written from."""
    torch.manual_seed(0)
    pixels = torch.from_numpy(image)
    if name == "openclip":
        clip = random_hub.scattered(small.build(vision=small.VIT))
        return clip_towers.VitDense(clip.visual, *SIZES[name])(pixels)
    if name == "siglip2":
        trunk = random_hub.siglip(random_hub.SIGLIP)[0].trunk
        patches = trunk.forward_features(pixels)
        # Each patch as the only one of an image of its own.
        alone = trunk.forward_head(patches[0][:, None])
        return (alone / alone.norm(dim=1, keepdim=True)).T.reshape(1, -1, *GRIDS[name])
    path = next((place / "hub").rglob("Talk2DINO*/model.safetensors"))
    vision, clip = random_hub.small_talk2dino(None, None, SIZES[name])
    return talk2dino.load(vision, clip, path)[0](pixels)


def codes(folder, image):
    """The codes of an image [32, n], and what they decode to [n, D]."""
    found = session.run(folder / "vision.onnx", [image])[0][0].reshape(32, -1)
    rows = np.ascontiguousarray(found.T)
    return found, session.run(folder / "decompress.onnx", [rows])[0]


@pytest.mark.parametrize("name", ["openclip", "siglip2", "talk2dino"])
def test_codes_are_the_networks_features_along_32_directions(place, made, name):
    with torch.inference_mode():
        features = in_torch(place, name, picture(name))[0].flatten(1).T.numpy()
    found, decoded = codes(made[name], picture(name))
    basis = session.run(made[name] / "decompress.onnx", [np.eye(32, dtype=np.float32)])[0]
    assert np.abs(basis @ basis.T - np.eye(32)).max() < 1e-4
    wanted = features @ basis.T
    assert least_cosine(found.T, wanted) > 0.9999
    assert least_cosine(decoded, wanted @ basis) > 0.9999
    # Negative control: another picture.
    assert least_cosine(codes(made[name], -picture(name))[0].T, wanted) < 0.99


def test_the_papers_codes_are_those_of_its_networks(made):
    clip, srd, auto_encoder = small.published()
    with torch.inference_mode():
        dense = clip_towers.ConvNextDense(clip.visual)(torch.from_numpy(picture("paper")))
        rows = srd(*dense).permute(0, 2, 3, 1).reshape(-1, small.FEATURE)
        wanted = auto_encoder.encoder(rows).numpy()
    assert least_cosine(codes(made["paper"], picture("paper"))[0].T, wanted) > 0.9999
    assert least_cosine(codes(made["paper"], picture("paper", 6))[0].T, wanted) < 0.98


@pytest.mark.parametrize("name", NAMES)
def test_manifest_and_card_describe_the_files(made, name):
    folder = made[name]
    manifest = tomllib.loads((folder / "manifest.toml").read_text())
    assert manifest["vision"]["grid"] == list(GRIDS[name])
    files = {path.name for path in folder.iterdir()}
    assert files == {*manifest["sha256"], "manifest.toml", "README.md"}
    for file in folder.glob("*.onnx"):
        onnx.checker.check_model(str(file))
    scale = manifest["relevancy"]
    assert scale["temperature"] > 0 and 0 <= scale.get("present_threshold", 0) <= 1
    card = (folder / "README.md").read_text()
    assert manifest["licence"] in card and "| tiny |" in card and f"| {name} |" in card
    lock = tomllib.loads((folder.parents[1] / "lock").read_text())
    for role in catalogue.entry(name).files:
        assert lock[f"{name}.{role}"]["sha256"] in card


def test_texts_of_talk2dino_are_mapped_embeddings_of_clip(place, made):
    path = next((place / "hub").rglob("Talk2DINO*/model.safetensors"))
    vision, clip = random_hub.small_talk2dino(None, None, SIZES["talk2dino"])
    text = talk2dino.load(vision, clip, path)[1]
    ids = Tokenizer.from_file(str(made["talk2dino"] / "tokenizer.json")).encode("a sofa").ids
    padded = torch.zeros(1, 77, dtype=torch.int64)
    padded[0, : len(ids)] = torch.tensor(ids)
    with torch.inference_mode():
        wanted = text.mapping(clip.encode_text(padded))
    assert least_cosine(Bundle(made["talk2dino"]).text(["a sofa"]), wanted) > 0.9999
    assert least_cosine(Bundle(made["talk2dino"]).text(["cup"]), wanted) < 0.999


def test_positions_of_dinov2_fit_another_grid(place):
    """At the size that the file has positions for, its own class and patch positions are used."""
    path = next((place / "hub").rglob("Talk2DINO*/model.safetensors"))
    vision, clip = random_hub.small_talk2dino(None, None, (70, 70))
    talk2dino.load(vision, clip, path)
    from safetensors.torch import load_file

    tensors = load_file(path)
    assert torch.allclose(vision.pos_embed, tensors["model.pos_embed"][:, 1:])
    first = tensors["model.cls_token"] + tensors["model.pos_embed"][:, :1]
    assert torch.allclose(vision.cls_token, first, atol=1e-6)


def test_texts_of_siglip_are_lower_case_and_filled_to_64_tokens(made):
    bundle = Bundle(made["siglip2"])
    ids = bundle.text.tokens("A Sofa")["input_ids"]
    assert ids.shape == (1, 64)
    assert ids[0, :4].tolist() == [2, 4, 1, 0], "<unk>, sofa, <eos>, <pad>"
    assert np.array_equal(bundle.text(["SOFA"]), bundle.text(["sofa"]))
    _, text = random_hub.siglip(random_hub.SIGLIP)
    torch.manual_seed(0)
    _, text = random_hub.siglip(random_hub.SIGLIP)
    with torch.inference_mode():
        wanted = text(torch.from_numpy(ids))[1]
    assert least_cosine(bundle.text(["A Sofa"]), wanted) > 0.9999
    assert least_cosine(bundle.text(["cup"]), wanted) < 0.9999


def test_a_siglip_whose_head_is_another_one_is_refused(place, tmp_path):
    path = next((place / "hub").rglob("vision_model.onnx"))
    out = tmp_path / "features.onnx"
    with pytest.raises(InputError, match=r"expected 6x7 patches, found 36"):
        from_siglip.write_features(path, (96, 96), (6, 7), out)
    model = onnx.load(path)
    surgery.renamed(model.graph, {"pooler_output": "pooled"})
    onnx.save(model, tmp_path / "other.onnx")
    with pytest.raises(InputError, match=r"expected pixel_values -> .*found .*pooled"):
        from_siglip.write_features(tmp_path / "other.onnx", (96, 96), (6, 6), out)


def test_a_failed_run_leaves_no_bundle_and_the_next_one_finishes(place, made):
    del made  # downloads and rooms are there
    shutil.rmtree(place / "cache" / "openclip")
    shutil.rmtree(place / "models" / "openclip")
    with Hub(place / "hub") as hub:
        hub.faults["open_clip_model.safetensors"] = [Fault(wrong=True)]
        with pytest.raises(InputError, match="what was downloaded is deleted"):
            make(place, "openclip", hub)
        assert not (place / "models" / "openclip").exists()
        assert (make(place, "openclip", hub) / "manifest.toml").exists()


def test_without_the_renderer_rooms_are_not_half_made(tmp_path):
    with pytest.raises(InputError, match=r"rooms could not be rendered.*is .*none built"):
        rooms.render(tmp_path / "none", tmp_path / "rooms")
    assert not list(tmp_path.glob("rooms/room-*"))


def test_siglip_needs_no_torch():
    """The modules that `bundle siglip2` imports."""
    code = (
        "import sys\nsys.modules['torch'] = None\n"
        "from lexsplat_training.bundles import command, from_siglip\n"
    )
    import subprocess

    root = Path(__file__).parent.parent
    subprocess.run([sys.executable, "-c", code], cwd=root, check=True)
    refused = subprocess.run(
        [sys.executable, "-c", code.replace("from_siglip", "from_clip")],
        cwd=root,
        capture_output=True,
        check=False,
    )
    assert refused.returncode == 1
