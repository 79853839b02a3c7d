"""Weight files that a user has, into modules: nothing is unpickled, and what does not fit is named.

In:  a module and a file: a state dict saved by torch (plain, or under "state_dict" or "model" as
     training frameworks write it), or safetensors. Tensors may lie below a prefix: it is found.
Out: the module with the file's weights; or WeightsError with the file, the tensor, and the shape
     that was expected and found.
"""

import pickle
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

NESTED = ("state_dict", "model", "module")  # where frameworks put the state dict
OPTIONAL = "num_batches_tracked"  # counts that no forward pass reads


class WeightsError(Exception):
    """A file that does not fit its module."""


def read(path):
    """A file's tensors by name."""
    path = Path(path)
    if not path.is_file():
        raise WeightsError(f"{path}: there is no such file")
    try:
        if path.suffix == ".safetensors":
            return load_file(path)
        state = torch.load(path, map_location="cpu", weights_only=True, mmap=False)
    except pickle.UnpicklingError as error:
        raise WeightsError(
            f"{path}: expected a state dict of plain tensors, found pickled objects that are not "
            "loaded because they could run code; where you trust the file and have the code it "
            "was saved with, save its state dict: torch.save(torch.load(FILE, weights_only=False)"
            f"['state_dict'], 'plain.pt') ({str(error).splitlines()[0]})") from None
    except (RuntimeError, EOFError, ValueError, SafetensorError) as error:
        raise WeightsError(f"{path}: not a weight file, or cut off: {error}") from None
    for key in NESTED:
        if isinstance(state, dict) and isinstance(state.get(key), dict):
            state = state[key]
    if not isinstance(state, dict):
        raise WeightsError(f"{path}: expected tensors by name, found a {type(state).__name__}")
    tensors = {name: value for name, value in state.items() if isinstance(value, torch.Tensor)}
    if not tensors:
        raise WeightsError(f"{path}: expected tensors by name, found none in {sorted(state)[:5]}")
    return tensors


def prefixes(tensors, names):
    """Below which prefixes some of a module's names are, the one with most of them first."""
    found = {}
    for key in tensors:
        for name in names:
            if key == name or key.endswith("." + name):
                prefix = key[:len(key) - len(name)]
                found[prefix] = found.get(prefix, 0) + 1
    return sorted(found, key=lambda prefix: (-found[prefix], len(prefix), prefix))


def fit(module, tensors, path, role):
    """Load `tensors` of the file `path` into a module. `role`: what it is, for messages."""
    wanted = {name: tensor for name, tensor in module.state_dict().items()
              if not name.endswith(OPTIONAL)}
    # A few names are enough to find the prefix, and keep the search short.
    candidates = prefixes(tensors, list(wanted)[:40])
    if not candidates:
        first = ", ".join(sorted(tensors)[:3])
        raise WeightsError(f"{path}: {role}: expected a tensor {next(iter(wanted))!r}, found none "
                           f"that ends so among {len(tensors)}, such as {first}")
    prefix = candidates[0]
    for name, tensor in wanted.items():
        found = tensors.get(prefix + name)
        if found is None:
            raise WeightsError(f"{path}: {role}: tensor {prefix + name!r}: expected shape "
                               f"{list(tensor.shape)}, found no such tensor")
        if found.shape != tensor.shape:
            raise WeightsError(f"{path}: {role}: tensor {prefix + name!r}: expected shape "
                               f"{list(tensor.shape)}, found {list(found.shape)}")
        if not found.isfinite().all():
            raise WeightsError(f"{path}: {role}: tensor {prefix + name!r}: expected finite "
                               "numbers, found NaN or infinity")
    module.load_state_dict({name: tensors[prefix + name].float() for name in wanted}, strict=False)
    return module.eval()


def load(module, path, role):
    """Read a file and load it into a module."""
    return fit(module, read(path), path, role)
