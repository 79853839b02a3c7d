"""Training images with a word per pixel: labelled RGB-D renders and image-level photographs.

In:  folders in the Replica layout (results/frame%06d.jpg, semantic/%06d.png with instance ids,
     instances.json with "id" and "class", traj.txt) and a folder of photographs whose file names
     end in their class (ImageNet style) with a segmentation network for them, each optional.
Out: batches (image [3, h, w] in 0..255, word index [h/4, w/4], weight [h/4, w/4]); word indices
     point into `Words`, so that the loss (paper, section 4.1) can look up the text embedding.

Photographs carry one word for the whole image; the class activation map of a classifier says
where it holds, and a segmentation network (Pascal VOC) where a few other things are. Photographs
stand alone, in mosaics, and what they show is pasted into frames. Drawn screens and prints
(`screens.py`) are pasted into both. All randomness: one seed.
"""

import io
import json
import queue
import threading
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

from screens import Screens

STRIDE = 4  # of the label grid against the image
# Pascal VOC's classes in the words of the vocabulary, "" where they are not asked for
VOC = ["", "airplane", "bicycle", "bird", "boat", "bottle", "bus", "car", "cat", "chair", "cow",
       "table", "dog", "horse", "motorcycle", "person", "potted plant", "sheep", "sofa", "train",
       "screen"]
# what else a labelled thing is called: data sets name the same thing differently
ALSO = {
    "tv screen": ["screen", "monitor", "television"], "monitor": ["screen", "computer screen"],
    "screen": ["monitor", "computer monitor", "tv screen"], "television": ["screen", "tv screen"],
    "desktop computer": ["computer screen", "monitor"], "entertainment center": ["tv screen"],
    "notebook": ["laptop"], "laptop": ["laptop computer"], "web site": ["screen"],
    "book jacket": ["book"], "comic book": ["book", "magazine"], "bookcase": ["bookshelf"],
    "dining table": ["table"], "coffee table": ["table"], "ashcan": ["trash can"],
    "studio couch": ["sofa"], "four-poster": ["bed"], "folding chair": ["chair"],
    "rocking chair": ["chair"], "barber chair": ["chair"], "coffee mug": ["mug", "cup"],
    "mug": ["cup"], "water bottle": ["bottle"], "pop bottle": ["bottle"],
    "wine bottle": ["bottle"], "beer bottle": ["bottle"], "table lamp": ["lamp"],
    "lampshade": ["lamp"], "wall clock": ["clock"], "chiffonier": ["chest of drawers"],
    "china cabinet": ["cabinet"], "medicine chest": ["cabinet"], "file": ["filing cabinet"],
    "kitchen cabinet": ["cabinet", "cupboard"], "rug": ["carpet"], "photo frame": ["picture"],
    "computer screen": ["screen", "monitor"], "magazine": ["book"],
    "computer keyboard": ["keyboard"], "cellular telephone": ["mobile phone"],
}
# classes of photographs that are seen indoors: drawn more often
INDOOR = set("""ashcan|backpack|ballpoint|bath towel|beaker|beer bottle|beer glass|binder|bookcase
|bookshop|bucket|candle|carton|cellular telephone|chest|chiffonier|china cabinet|coffee mug
|coffeepot|comic book|computer keyboard|crate|cup|desk|desktop computer|digital clock|dining table
|dishwasher|doormat|electric fan|entertainment center|envelope|espresso maker|file|folding chair
|four-poster|frying pan|grocery store|hamper|hand-held computer|home theater|iPod|iron|lampshade
|laptop|library|loudspeaker|medicine chest|menu|microwave|mixing bowl|modem|monitor|mouse|notebook
|packet|paper towel|pencil box|pill bottle|pillow|pitcher|plate|plastic bag|plate rack|pop bottle
|pot|printer|quilt|radiator|radio|refrigerator|remote control|restaurant|rocking chair|screen
|shoji|shower curtain|sliding door|soap dispenser|space bar|spatula|stove|studio couch|table lamp
|teapot|teddy|television|theater curtain|throne|toaster|tray|typewriter keyboard|vase|wall clock
|wardrobe|washbasin|washer|water bottle|water jug|web site|window screen|window shade|wine bottle
|wooden spoon|book jacket|barber chair|banana|orange|lemon|Granny Smith|bagel|pizza""".replace(
    "\n", "").split("|"))


class Words:
    """All words that label pixels, and which words may stand for another (synonyms)."""

    def __init__(self, vocabulary=None, held_out=()):
        """Names in `held_out` never become words, not even as a synonym.

        A row of the vocabulary brings its synonyms and, as one more, what it defines a thing by.
        """
        self.names, self.index, self.synonyms = [], {}, []
        self.known, self.held_out = {}, set(held_out)
        if vocabulary:
            for row in json.loads(Path(vocabulary).read_text()):
                texts = [*row.get("synonyms", []), row.get("definition")]
                self.known.setdefault(row["name"], [text for text in texts if text])

    def add(self, name, synonyms=()):
        """The index of a word; new words bring their synonyms."""
        if name not in self.index:
            self.index[name] = len(self.names)
            self.names.append(name)
            self.synonyms.append([])
            others = [s for s in [*synonyms, *ALSO.get(name, []), *self.known.get(name, [])]
                      if s != name and s not in self.held_out]
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
        if row["class"] not in words.held_out:
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


def segmenter(path):
    """DeepLabV3 (a TFLite file): rgb -> Pascal VOC class per pixel, uint8 [128, 128]."""
    from ai_edge_litert.interpreter import Interpreter

    net = Interpreter(str(path), num_threads=2)
    net.allocate_tensors()
    taken, given = net.get_input_details()[0], net.get_output_details()[0]
    height, width = taken["shape"][1:3]

    def classes(image):
        x = resize(image, int(width), int(height), Image.Resampling.BILINEAR)
        net.set_tensor(taken["index"], x[None])
        net.invoke()
        found = net.get_tensor(given["index"])[0].astype(np.uint8)
        return resize(found, 128, 128, Image.Resampling.NEAREST)

    return classes


def cached(cache, function, items):
    """[function(item, number) ...] stacked, kept in a file from run to run."""
    if not cache.exists():
        np.save(cache, np.stack([function(item, k) for k, item in enumerate(items)]))
    return np.load(cache)


def read_photos(folder, words, activation, segment, caches):
    """Yields (rgb uint8, word, activation map 0..1, VOC class map) of each photograph.

    `activation(rgb, class index)` and `segment(rgb)` make the maps; `caches`: two files for them.
    Photographs of a held-out word are left out.
    """
    files = sorted(Path(folder).glob("*.jpg"))
    images = [np.asarray(Image.open(path).convert("RGB")) for path in files]
    heats = cached(caches[0], activation, images)
    classes = cached(caches[1], lambda image, _: segment(image), images)
    for path, image, heat, voc in zip(files, images, heats, classes):
        name = path.stem.split("_", 1)[1].replace("_", " ")
        if name not in words.held_out:
            yield image, words.add(name), heat, voc


def resize(array, width, height, method):
    """PIL's resize for any one-channel or RGB array."""
    return np.asarray(Image.fromarray(array).resize((width, height), method))


def photometric(image, random):
    """Brightness, contrast, saturation, color cast, gamma, blur, noise and JPEG, each by chance."""
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
    """Random crops of frames and of photographs (alone, as a mosaic of four, or pasted)."""

    def __init__(self, frames, photos, words, size, share, seed, screens=0.0):
        """`frames`: [(weight, frames)], `size`: (width, height), `share`: of photographs;
        `screens`: chance of drawn screens and prints."""
        self.frames = [frame for _, some in frames for frame in some]
        chance = np.array([weight for weight, some in frames for _ in some], float)
        self.chance = np.cumsum(chance) / chance.sum()
        self.photos, self.words = photos, words
        self.size, self.share, self.random = size, share, np.random.default_rng(seed)
        self.drawn = Screens(words, [photo[0] for photo in photos], self.random)
        self.screens = screens
        self.voc = [words.add(name) if name and photos else -1 for name in VOC]
        likely = np.array([4.0 if words.names[word] in INDOOR else 1.0 for _, word, *_ in photos])
        self.likely = np.cumsum(likely) / likely.sum() if photos else likely

    def crop(self, image, labels, least, size):
        """A random part of an image and its label maps, stretched to `size`."""
        width, height = size
        r, (h, w) = self.random, image.shape[:2]
        scale = r.uniform(least, 1.0)
        ch, cw = int(h * scale * r.uniform(0.85, 1.0)), int(w * scale * r.uniform(0.85, 1.0))
        y, x = r.integers(0, h - ch + 1), r.integers(0, w - cw + 1)
        step = -1 if r.random() < 0.5 else 1
        image, *labels = (a[y:y + ch, x:x + cw][:, ::step] for a in (image, *labels))
        nearest = Image.Resampling.NEAREST
        small = [resize(np.ascontiguousarray(label), width // STRIDE, height // STRIDE, nearest)
                 for label in labels]
        return resize(np.ascontiguousarray(image), width, height, Image.Resampling.BILINEAR), small

    def frame(self, size):
        """One labelled view; small segments weigh more (inverse root of their area)."""
        image, label = self.frames[np.searchsorted(self.chance, self.random.random())]
        image, (label,) = self.crop(image, [label.astype(np.int32)], 0.45, size)
        image, label = image.copy(), label.copy()
        if self.photos and self.random.random() < 0.3:
            for _ in range(self.random.integers(1, 4)):
                self.paste(image, label)
        if self.random.random() < self.screens:
            self.drawn.put(image, label)
        word, weight = np.full(label.shape, -1, np.int64), np.zeros(label.shape, np.float32)
        for value in np.unique(label[label >= 0]):
            where = label == value
            word[where] = self.words.draw(value, self.random, 0.15)
            weight[where] = 1 / np.sqrt(where.sum())
        return photometric(image, self.random), word, weight / max(weight.mean(), 1e-6)

    def paste(self, image, label):
        """Puts what a photograph shows into a frame, in place."""
        r, (rows, columns) = self.random, label.shape
        side = int(r.uniform(0.2, 0.55) * rows)
        photo, word, weight = self.photo((side * STRIDE, side * STRIDE))
        values, counts = np.unique(word[word >= 0], return_counts=True)
        if not len(values):
            return
        shown = word == values[counts.argmax()]
        if shown.mean() < 0.05:
            return
        y, x = r.integers(0, rows - side + 1), r.integers(0, columns - side + 1)
        label[y:y + side, x:x + side][shown] = values[counts.argmax()]
        alpha = Image.fromarray(shown.astype(np.uint8) * 255).resize(photo.shape[1::-1])
        alpha = np.asarray(alpha, np.float32)[..., None] / 255
        part = image[y * STRIDE:(y + side) * STRIDE, x * STRIDE:(x + side) * STRIDE]
        part[:] = (photo * alpha + part * (1 - alpha)).astype(np.uint8)

    def photo(self, size):
        """One photograph; its word counts where the activation map is high or its thing is."""
        row = self.photos[np.searchsorted(self.likely, self.random.random())]
        image, own, heat, voc = row
        height, width = image.shape[:2]
        heat = resize(heat, width, height, Image.Resampling.BILINEAR)
        voc = resize(voc, width, height, Image.Resampling.NEAREST)
        image, (heat, voc) = self.crop(image, [heat, voc], 0.6, size)
        own = self.words.draw(own, self.random, 0.2)
        weight = np.where(heat > 0.5, heat, 0.0).astype(np.float32)
        word = np.where(weight > 0, own, -1).astype(np.int64)
        for value in np.unique(voc[voc > 0]):
            where = voc == value
            if where.mean() < 0.01:
                continue
            mine = heat[where].mean() > 0.5  # what the photograph was taken of
            if mine:
                word[word == own] = -1
            word[where] = own if mine and self.random.random() < 0.6 else self.voc[value]
            weight[where] = 0.8
        return image, word, np.where(word >= 0, weight, 0).astype(np.float32)

    def mosaic(self, size):
        """Four photographs side by side, or one."""
        width, height = size
        if self.random.random() < 0.4:
            return self.finish(*self.photo(size))
        cut = STRIDE * 4
        x = int(self.random.integers(width // 3, width * 2 // 3)) // cut * cut
        y = int(self.random.integers(height // 3, height * 2 // 3)) // cut * cut
        rows = [[self.photo((w, h)) for w in (x, width - x)] for h in (y, height - y)]
        image, word, weight = (
            np.concatenate([np.concatenate([part[k] for part in row], 1) for row in rows])
            for k in range(3)
        )
        return self.finish(image, word, weight)

    def finish(self, image, word, weight):
        """Photographs with, by chance, drawn screens and prints on them."""
        if self.random.random() < self.screens:
            image, label = image.copy(), np.full(word.shape, -1)
            self.drawn.put(image, label)
            word = np.where(label >= 0, label, word)
            weight = np.where(label >= 0, 0.8, weight)
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
