"""Screens and prints, drawn flat."""

import numpy as np
from PIL import Image, ImageDraw

LIGHTS = [(0, 190, 215), (40, 200, 225), (20, 100, 220), (245, 248, 250), (235, 240, 255)]


class Pages:
    """Draws screens and prints at random.

    `screen` and `print` return (picture, light, part), PIL images of one size: `light` is 255 where
    light is emitted, `part` is 1 on the object and 2 on a laptop's keyboard.
    """

    def __init__(self, photos, random):
        self.photos, self.random = photos, random

    def color(self, low=0, high=256):
        """(r, g, b), each from `low` to below `high`."""
        return tuple(int(c) for c in self.random.integers(low, high, 3))

    def light(self):
        """A color of light: cyan, blue, white or any bright one."""
        return LIGHTS[self.random.integers(5)] if self.random.random() < 0.6 else self.color(60)

    def ground(self, w, h, first, second):
        """A gradient between two colors, or a photograph: w x h pixels."""
        r = self.random
        if self.photos and r.random() < 0.3:
            return Image.fromarray(self.photos[r.integers(len(self.photos))]).resize((w, h))
        ramp = Image.linear_gradient("L").rotate(90 * r.integers(4)).resize((w, h))
        return Image.composite(*(Image.new("RGB", (w, h), c) for c in (first, second)), ramp)

    def lines(self, page, box, ink, step):
        """Draws lines of words (bars) into a box, in place; `step`: height of a line in pixels."""
        (x0, y0, x1, y1), draw = box, ImageDraw.Draw(page)
        for y in np.arange(y0, y1 - step / 2, step):
            x, stop = x0, x0 + (x1 - x0) * self.random.uniform(0.5, 1.0)
            while x < stop:
                end = min(x + self.random.uniform(1, 4) * step, x1)
                draw.rectangle((x, y, end, y + step * 0.4), fill=ink)
                x = end + step * 0.6

    def blocks(self, page, count, color):
        """Draws windows, tiles, photographs and columns of text on a page, in place.

        color: a function that draws their color.
        """
        r, (w, h) = self.random, page.size
        for _ in range(count):
            bw, bh = int(w * r.uniform(0.15, 0.6)), int(h * r.uniform(0.15, 0.6))
            x, y = int(r.integers(w - bw)), int(r.integers(h - bh))
            paper = (245, 246, 248) if r.random() < 0.5 else color()
            page.paste(self.ground(bw, bh, paper, paper), (x, y))
            if r.random() < 0.5:
                page.paste(color(), (x, y, x + bw + 1, y + h // 25 + 1))
            if r.random() < 0.7:
                box = (x + 4, y + 8, x + bw - 4, y + bh - 2)
                self.lines(page, box, self.color(0, 120), r.uniform(4, 9))

    def screen(self):
        """A bezel with a bright page in it, or switched off; now and then a keyboard below."""
        r, w, kind = self.random, 240, self.random.random()
        h = int(w / r.choice([16 / 9, 16 / 9, 16 / 10, 4 / 3]))
        page, off = self.shown(w, h, kind), kind < 0.15
        edge, tone = int(w * r.uniform(0.012, 0.06)), r.integers(4, 45)
        tone = int(tone if r.random() < 0.75 else r.integers(90, 245))
        top = h + 2 * edge + int(h * r.choice([0, 0, 0.05, 0.12]))
        keys = int(h * r.uniform(0.3, 0.8)) if r.random() < 0.12 else 0
        whole = Image.new("RGB", (w + 2 * edge, top + keys), (tone,) * 3)
        light, part = Image.new("L", whole.size), Image.new("L", whole.size, 1)
        whole.paste(page, (edge, edge))
        light.paste(0 if off else 255, (edge, edge, edge + w, edge + h))
        part.paste(2, (0, top, *whole.size))
        ink = self.color(0, 60) if tone > 80 else self.color(60, 120)
        self.lines(whole, (20, top + 8, w, top + keys * 0.6), ink, max(keys / 8, 3))
        return whole, light, part

    def shown(self, w, h, kind):
        """What a screen shows; `kind` in 0..1, below 0.15: it is off."""
        r = self.random
        page = self.ground(w, h, self.light(), self.light())
        if kind < 0.15:  # dark, with a reflection
            dark = r.integers(4, 40, 3)
            page = self.ground(w, h, tuple(dark), tuple(dark + r.integers(5, 70)))
        elif kind < 0.65:  # a desktop, or a page of tiles
            self.blocks(page, r.integers(1, 7), self.light)
        elif kind < 0.75:  # a menu
            box = (w * 0.1, h * 0.15, w * 0.9, h * 0.9)
            self.lines(page, box, self.light(), h * r.uniform(0.06, 0.15))
        elif kind < 0.82:  # a chart
            for x in np.linspace(w * 0.1, w * 0.85, r.integers(4, 12)):
                bar = (x, h * r.uniform(0.15, 0.8), x + w * 0.05, h * 0.9)
                ImageDraw.Draw(page).rectangle(bar, fill=self.light())
        return page

    def print(self, word):
        """A sheet ("paper"), a framed "picture", or for other words a poster or cover."""
        r, w = self.random, 180
        h = int(w * r.choice([1.41, 1.3, 0.71, 1.0, 1.5]))
        white = tuple(r.integers(215, 256) - r.integers(0, 16, 3))
        plain = word == "paper" or (word != "picture" and r.random() < 0.3)
        first, second = (white, white) if plain else (self.color(), self.color())
        page = Image.new("RGB", (w, h), first) if plain else self.ground(w, h, first, second)
        if word == "picture":
            page = self.framed(page, white)
        else:
            self.blocks(page, r.integers(3) * (word != "paper"), self.color)
            ink = self.color(0, 90) if plain else self.color()
            title = (w * 0.1, h * 0.07, w * 0.9, h * 0.25)
            self.lines(page, title, ink, h * r.uniform(0.05, 0.15))
            body = (w * 0.1, h * r.uniform(0.3, 0.9), w * 0.9, h * 0.93)
            self.lines(page, body, ink, r.uniform(5, 12))
        return page, Image.new("L", page.size), Image.new("L", page.size, 1)

    def framed(self, page, white):
        """A page with a frame, by chance with a `white` mat between."""
        r, (w, h) = self.random, page.size
        mat, edge = int(r.choice([0, 0, 12, 30])), int(r.uniform(4, 18))
        wood = self.color(10, 60) if r.random() < 0.4 else self.color(40, 230)
        whole = Image.new("RGB", (w + 2 * (mat + edge), h + 2 * (mat + edge)), wood)
        whole.paste(white, (edge, edge, whole.width - edge, whole.height - edge))
        whole.paste(page, (mat + edge, mat + edge))
        return whole
