"""Reads a user's weight files into modules. No code in a file is run.

A file is a state dict saved by torch (plain, or under "state_dict", "model" or "module" as training
frameworks write it) or safetensors. Its tensors may have a prefix, which is found.
"""

import pickle
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from ..command_line import InputError

NESTED = ("state_dict", "model", "module")  # keys under which frameworks put the state dict
OPTIONAL = "num_batches_tracked"  # a counter that no forward pass reads


class WeightsError(InputError):
    """A weight file does not fit its module; names file, tensor, and expected and found shape."""


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
            f"{path}: expected a state dict of plain tensors, found pickled objects, which could "
            "run code and are not loaded; if you trust the file and have the code that saved it, "
            "save its state dict: torch.save(torch.load(FILE, weights_only=False)"
            f"['state_dict'], 'plain.pt') ({str(error).splitlines()[0]})"
        ) from None
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
    """The prefixes before a module's tensor names, the most frequent one first."""
    found = {}
    for key in tensors:
        for name in names:
            if key == name or key.endswith("." + name):
                prefix = key[: len(key) - len(name)]
                found[prefix] = found.get(prefix, 0) + 1
    return sorted(found, key=lambda prefix: (-found[prefix], len(prefix), prefix))


def fit(module, tensors, path, role):
    """Loads `tensors` of the file `path` into a module; `role` names the module in errors."""
    wanted = {
        name: tensor for name, tensor in module.state_dict().items() if not name.endswith(OPTIONAL)
    }
    # 40 names are enough to find the prefix, and keep the search short.
    candidates = prefixes(tensors, list(wanted)[:40])
    if not candidates:
        first = ", ".join(sorted(tensors)[:3])
        raise WeightsError(
            f"{path}: {role}: expected a tensor {next(iter(wanted))!r}, found none "
            f"that ends so among {len(tensors)}, such as {first}"
        )
    prefix = candidates[0]
    for name, tensor in wanted.items():
        found = tensors.get(prefix + name)
        if found is None:
            raise WeightsError(
                f"{path}: {role}: tensor {prefix + name!r}: expected shape "
                f"{list(tensor.shape)}, found no such tensor"
            )
        if found.shape != tensor.shape:
            raise WeightsError(
                f"{path}: {role}: tensor {prefix + name!r}: expected shape "
                f"{list(tensor.shape)}, found {list(found.shape)}"
            )
        if not found.isfinite().all():
            raise WeightsError(
                f"{path}: {role}: tensor {prefix + name!r}: expected finite "
                "numbers, found NaN or infinity"
            )
    module.load_state_dict({name: tensors[prefix + name].float() for name in wanted}, strict=False)
    return module.eval()


def load(module, path, role):
    """Loads a file's tensors into a module."""
    return fit(module, read(path), path, role)
