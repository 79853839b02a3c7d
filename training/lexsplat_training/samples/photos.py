"""Photographs of one class each (files named ID_CLASS.jpg), with maps of where the class is."""

from pathlib import Path

import numpy as np

from . import images


def class_of(path):
    """The class in a photograph's file name."""
    return path.stem.split("_", 1)[1].replace("_", " ")


def segmenter(path):
    """DeepLabV3 (a TFLite file) as a function: rgb -> Pascal VOC class, uint8 [128, 128]."""
    from ai_edge_litert.interpreter import Interpreter

    net = Interpreter(str(path), num_threads=2)
    net.allocate_tensors()
    taken, given = net.get_input_details()[0], net.get_output_details()[0]
    height, width = taken["shape"][1:3]

    def classes(image):
        x = images.resize(image, int(width), int(height), images.BILINEAR)
        net.set_tensor(taken["index"], x[None])
        net.invoke()
        found = net.get_tensor(given["index"])[0].astype(np.uint8)
        return images.resize(found, 128, 128, images.NEAREST)

    return classes


def cached(cache, function, items):
    """[function(item, number) ...] stacked; kept in the file `cache` from run to run."""
    if not cache.exists():
        np.save(cache, np.stack([function(item, k) for k, item in enumerate(items)]))
    return np.load(cache)


def read_photos(folder, words, activation, segment, caches):
    """Yields (rgb uint8, word, activation map 0..1, VOC class map) of each photograph.

    `activation(rgb, class number)` and `segment(rgb)` compute the maps, `caches` are two files for
    them. The class number is the file's place in the folder. Held-out classes are left out.
    """
    files = sorted(Path(folder).glob("*.jpg"))
    pictures = [images.read(path) for path in files]
    heats = cached(caches[0], activation, pictures)
    classes = cached(caches[1], lambda image, _: segment(image), pictures)
    for path, image, heat, voc in zip(files, pictures, heats, classes, strict=True):
        name = class_of(path)
        if name not in words.held_out:
            yield image, words.add(name), heat, voc
