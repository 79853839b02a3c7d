"""Training images with a word per pixel: labelled RGB-D renders and image-level photographs.

In:  folders in the Replica layout (results/frame%06d.jpg, semantic/%06d.png with instance ids,
     instances.json with "id" and "class", traj.txt) and a folder of photographs whose file names
     end in their class (ImageNet style), each optional.
Out: batches (image [3, h, w] in 0..255, word index [h/4, w/4], weight [h/4, w/4]); word indices
     point into `Words`, so that the loss (paper, section 4.1) can look up the text embedding.

Photographs carry one word for the whole image; the class activation map of a classifier says
where it holds. All randomness comes from one seed.
"""

import io
import json
import queue
import threading
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

STRIDE = 4  # of the label grid against the image


class Words:
    """All words that label pixels, and which words may stand for another (synonyms)."""

    def __init__(self, vocabulary=None):
        self.names, self.index, self.synonyms = [], {}, []
        self.known = {}
        if vocabulary:
            for row in json.loads(Path(vocabulary).read_text()):
                self.known.setdefault(row["name"], row.get("synonyms", []))

    def add(self, name, synonyms=()):
        """The index of a word; new words bring their synonyms."""
        if name not in self.index:
            self.index[name] = len(self.names)
            self.names.append(name)
            self.synonyms.append([])
            others = [s for s in [*synonyms, *self.known.get(name, [])] if s != name]
            self.synonyms[self.index[name]] = [self.add(s) for s in dict.fromkeys(others)]
        return self.index[name]

    def draw(self, word, random, chance):
        """The word itself, or now and then one of its synonyms."""
        others = self.synonyms[word]
        return int(random.choice(others)) if others and random.random() < chance else word


def read_frames(folder, words, skip=None, limit=None):
    """Yields (rgb uint8, word per pixel int16, -1 = none) of one labelled folder.

    `skip` is a box (x0, y0, x1, y1) in metres: views taken from inside it are left out.
    """
    folder = Path(folder)
    rows = json.loads((folder / "instances.json").read_text())
    table = np.full(65536, -1, np.int16)
    for row in rows:
        table[row["id"]] = words.add(row["class"])
    poses = np.loadtxt(folder / "traj.txt").reshape(-1, 4, 4)
    files = sorted((folder / "results").glob("frame*.jpg"))
    for path, pose in list(zip(files, poses))[:limit]:
        x, y = pose[0, 3], pose[1, 3]
        if skip and skip[0] < x < skip[2] and skip[1] < y < skip[3]:
            continue
        number = path.stem.removeprefix("frame")
        mask = np.asarray(Image.open(folder / "semantic" / f"{number}.png"))
        yield np.asarray(Image.open(path).convert("RGB")), table[mask]


def read_photos(folder, words, activation, cache):
    """Yields (rgb uint8, word, activation map 0..1) of each photograph.

    `activation(rgb, class index)` makes the map; all maps are kept in the file `cache`.
    """
    files = sorted(Path(folder).glob("*.jpg"))
    images = [np.asarray(Image.open(path).convert("RGB")) for path in files]
    if not cache.exists():
        np.save(cache, np.stack([activation(image, k) for k, image in enumerate(images)]))
    for path, image, heat in zip(files, images, np.load(cache)):
        yield image, words.add(path.stem.split("_", 1)[1].replace("_", " ")), heat


def resize(array, width, height, method):
    """PIL's resize for any one-channel or RGB array."""
    return np.asarray(Image.fromarray(array).resize((width, height), method))


def photometric(image, random):
    """Brightness, contrast, saturation, colour cast, gamma, blur, noise and JPEG, each by chance."""
    x = image.astype(np.float32)
    if random.random() < 0.8:
        x = (x - x.mean()) * random.uniform(0.6, 1.4) + x.mean() * random.uniform(0.6, 1.4)
        grey = x.mean(2, keepdims=True)
        x = grey + (x - grey) * random.uniform(0.3, 1.5)
        x = x * random.uniform(0.85, 1.15, 3).astype(np.float32)
    x = np.clip(x, 0, 255)
    if random.random() < 0.3:
        x = 255 * (x / 255) ** random.uniform(0.7, 1.4)
    if random.random() < 0.3:
        x = x + random.normal(0, random.uniform(2, 12), x.shape)
    picture = Image.fromarray(np.clip(x, 0, 255).astype(np.uint8))
    if random.random() < 0.25:
        picture = picture.filter(ImageFilter.GaussianBlur(random.uniform(0.4, 1.5)))
    if random.random() < 0.3:
        buffer = io.BytesIO()
        picture.save(buffer, "JPEG", quality=int(random.integers(25, 90)))
        picture = Image.open(buffer)
    return np.asarray(picture)


class Scenes:
    """Random crops of frames and of photographs (alone or as a mosaic of four)."""

    def __init__(self, frames, photos, words, size, share, seed):
        """`size` is (width, height), `share` the fraction of photographs."""
        self.frames, self.photos, self.words = frames, photos, words
        self.size, self.share, self.random = size, share, np.random.default_rng(seed)

    def crop(self, image, label, least, size):
        """A random part of image and label, stretched to `size`."""
        width, height = size
        r, (h, w) = self.random, image.shape[:2]
        scale = r.uniform(least, 1.0)
        ch, cw = int(h * scale * r.uniform(0.85, 1.0)), int(w * scale * r.uniform(0.85, 1.0))
        y, x = r.integers(0, h - ch + 1), r.integers(0, w - cw + 1)
        image, label = image[y:y + ch, x:x + cw], label[y:y + ch, x:x + cw]
        if r.random() < 0.5:
            image, label = image[:, ::-1], label[:, ::-1]
        nearest = Image.Resampling.NEAREST
        small = resize(np.ascontiguousarray(label), width // STRIDE, height // STRIDE, nearest)
        return resize(np.ascontiguousarray(image), width, height, Image.Resampling.BILINEAR), small

    def frame(self, size):
        """One labelled view; small segments weigh more (inverse root of their area)."""
        image, label = self.frames[self.random.integers(len(self.frames))]
        image, label = self.crop(image, label.astype(np.int32), 0.45, size)
        word, weight = np.full(label.shape, -1, np.int64), np.zeros(label.shape, np.float32)
        for value in np.unique(label[label >= 0]):
            where = label == value
            word[where] = self.words.draw(value, self.random, 0.15)
            weight[where] = 1 / np.sqrt(where.sum())
        return photometric(image, self.random), word, weight / max(weight.mean(), 1e-6)

    def photo(self, size):
        """One photograph; its word counts where the activation map is high."""
        image, word, heat = self.photos[self.random.integers(len(self.photos))]
        heat = resize(heat, image.shape[1], image.shape[0], Image.Resampling.BILINEAR)
        image, heat = self.crop(image, heat, 0.6, size)
        word = self.words.draw(word, self.random, 0.2)
        weight = np.where(heat > 0.5, heat, 0.0).astype(np.float32)
        return image, np.where(weight > 0, word, -1).astype(np.int64), weight

    def mosaic(self, size):
        """Four photographs side by side, or one."""
        width, height = size
        if self.random.random() < 0.4:
            image, word, weight = self.photo(size)
            return photometric(image, self.random), word, weight
        cut = STRIDE * 4
        x = int(self.random.integers(width // 3, width * 2 // 3)) // cut * cut
        y = int(self.random.integers(height // 3, height * 2 // 3)) // cut * cut
        rows = [[self.photo((w, h)) for w in (x, width - x)] for h in (y, height - y)]
        image, word, weight = (
            np.concatenate([np.concatenate([part[k] for part in row], 1) for row in rows])
            for k in range(3)
        )
        return photometric(image, self.random), word, weight

    def draw(self, size):
        """(image float32 [3, h, w], word int64, weight float32)."""
        photo = self.photos and (not self.frames or self.random.random() < self.share)
        image, word, weight = self.mosaic(size) if photo else self.frame(size)
        return image.transpose(2, 0, 1).astype(np.float32), word, weight.astype(np.float32)


def batches(scenes, size, ahead=4):
    """Endless batches of `size` draws, prepared ahead in one thread; `scenes.size` may change."""
    ready = queue.Queue(ahead)

    def work():
        try:
            while True:
                whole = scenes.size
                draws = [scenes.draw(whole) for _ in range(size)]
                ready.put([np.stack(part) for part in zip(*draws)])
        except Exception as error:  # handed to the consumer, which raises it
            ready.put(error)

    threading.Thread(target=work, daemon=True).start()
    while True:
        batch = ready.get()
        if isinstance(batch, Exception):
            raise batch
        yield batch
