"""The words that label pixels, their synonyms, and words of other data sets."""

import json
from pathlib import Path

# Pascal VOC's classes in the words of the vocabulary; "" for the background
VOC = [
    "", "airplane", "bicycle", "bird", "boat", "bottle", "bus", "car", "cat", "chair", "cow",
    "table", "dog", "horse", "motorcycle", "person", "potted plant", "sheep", "sofa", "train",
    "screen",
]  # fmt: skip
# further names of labelled objects: data sets name the same object differently
ALSO = {
    "tv screen": ["screen", "monitor", "television"],
    "monitor": ["screen", "computer screen"],
    "screen": ["monitor", "computer monitor", "tv screen"],
    "television": ["screen", "tv screen"],
    "desktop computer": ["computer screen", "monitor"],
    "entertainment center": ["tv screen"],
    "notebook": ["laptop"],
    "laptop": ["laptop computer"],
    "web site": ["screen"],
    "book jacket": ["book"],
    "comic book": ["book", "magazine"],
    "bookcase": ["bookshelf"],
    "dining table": ["table"],
    "coffee table": ["table"],
    "ashcan": ["trash can"],
    "studio couch": ["sofa"],
    "four-poster": ["bed"],
    "folding chair": ["chair"],
    "rocking chair": ["chair"],
    "barber chair": ["chair"],
    "coffee mug": ["mug", "cup"],
    "mug": ["cup"],
    "water bottle": ["bottle"],
    "pop bottle": ["bottle"],
    "wine bottle": ["bottle"],
    "beer bottle": ["bottle"],
    "table lamp": ["lamp"],
    "lampshade": ["lamp"],
    "wall clock": ["clock"],
    "chiffonier": ["chest of drawers"],
    "china cabinet": ["cabinet"],
    "medicine chest": ["cabinet"],
    "file": ["filing cabinet"],
    "kitchen cabinet": ["cabinet", "cupboard"],
    "rug": ["carpet"],
    "photo frame": ["picture"],
    "computer screen": ["screen", "monitor"],
    "magazine": ["book"],
    "computer keyboard": ["keyboard"],
    "cellular telephone": ["mobile phone"],
}
# classes of photographs that are seen indoors: the sampler draws them more often
INDOOR = {
    "ashcan", "backpack", "ballpoint", "bath towel", "beaker", "beer bottle", "beer glass",
    "binder", "bookcase", "bookshop", "bucket", "candle", "carton", "cellular telephone", "chest",
    "chiffonier", "china cabinet", "coffee mug", "coffeepot", "comic book", "computer keyboard",
    "crate", "cup", "desk", "desktop computer", "digital clock", "dining table", "dishwasher",
    "doormat", "electric fan", "entertainment center", "envelope", "espresso maker", "file",
    "folding chair", "four-poster", "frying pan", "grocery store", "hamper", "hand-held computer",
    "home theater", "iPod", "iron", "lampshade", "laptop", "library", "loudspeaker",
    "medicine chest", "menu", "microwave", "mixing bowl", "modem", "monitor", "mouse", "notebook",
    "packet", "paper towel", "pencil box", "pill bottle", "pillow", "pitcher", "plate",
    "plastic bag", "plate rack", "pop bottle", "pot", "printer", "quilt", "radiator", "radio",
    "refrigerator", "remote control", "restaurant", "rocking chair", "screen", "shoji",
    "shower curtain", "sliding door", "soap dispenser", "space bar", "spatula", "stove",
    "studio couch", "table lamp", "teapot", "teddy", "television", "theater curtain", "throne",
    "toaster", "tray", "typewriter keyboard", "vase", "wall clock", "wardrobe", "washbasin",
    "washer", "water bottle", "water jug", "web site", "window screen", "window shade",
    "wine bottle", "wooden spoon", "book jacket", "barber chair", "banana", "orange", "lemon",
    "Granny Smith", "bagel", "pizza",
}  # fmt: skip


class Words:
    """Numbered words. Each has synonyms: numbers of words that may stand for it."""

    def __init__(self, vocabulary=None, held_out=()):
        """Words in `held_out` get no number, not even as a synonym.

        vocabulary: a JSON file of rows with "name" and optionally "synonyms" and "definition"; the
        definition counts as one more synonym.
        """
        self.names, self.index, self.synonyms = [], {}, []
        self.known, self.held_out = {}, set(held_out)
        if vocabulary:
            for row in json.loads(Path(vocabulary).read_text()):
                texts = [*row.get("synonyms", []), row.get("definition")]
                self.known.setdefault(row["name"], [text for text in texts if text])

    def add(self, name):
        """The number of a word. A new word is numbered, and so are its synonyms."""
        if name not in self.index:
            self.index[name] = len(self.names)
            self.names.append(name)
            self.synonyms.append([])
            texts = [*ALSO.get(name, []), *self.known.get(name, [])]
            others = [text for text in texts if text != name and text not in self.held_out]
            self.synonyms[self.index[name]] = [self.add(text) for text in dict.fromkeys(others)]
        return self.index[name]

    def draw(self, word, random, chance):
        """The word itself, or with the probability `chance` one of its synonyms."""
        others = self.synonyms[word]
        return int(random.choice(others)) if others and random.random() < chance else word
