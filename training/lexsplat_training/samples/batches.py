"""Batches of samples, prepared ahead in one thread."""

import queue
import threading

import numpy as np


def batches(sampler, count, ahead=4):
    """Yields endless batches of `count` samples: three arrays, stacked.

    All samples of a batch have the `sampler.size` of its beginning; the caller may change it.
    """
    ready = queue.Queue(ahead)

    def work():
        try:
            while True:
                size = sampler.size
                draws = [sampler.draw(size) for _ in range(count)]
                ready.put([np.stack(part) for part in zip(*draws, strict=True)])
        except Exception as error:  # the consumer raises it
            ready.put(error)

    threading.Thread(target=work, daemon=True).start()
    while True:
        batch = ready.get()
        if isinstance(batch, Exception):
            raise batch
        yield batch
