"""Images as arrays uint8 [h, w, 3]: resized, and changed as cameras change them."""

import io

import numpy as np
from PIL import Image, ImageFilter

BILINEAR, NEAREST = Image.Resampling.BILINEAR, Image.Resampling.NEAREST


def read(path):
    """A file as RGB."""
    return np.asarray(Image.open(path).convert("RGB"))


def resize(array, width, height, method):
    """PIL's resize for RGB or one channel."""
    return np.asarray(Image.fromarray(array).resize((width, height), method))


def photometric(image, random):
    """Brightness, contrast, saturation, color cast, gamma, noise, blur and JPEG, each by chance."""
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
