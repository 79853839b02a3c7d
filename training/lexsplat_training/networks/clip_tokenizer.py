"""CLIP's tokenizer in the format of the library `tokenizers`, which the server reads.

The vocabulary as CLIP defines it: 256 bytes, the same bytes at the end of a word, the merges of
open_clip's file in their order, a start and an end token.
"""

import gzip
from pathlib import Path

import open_clip
from tokenizers import Regex, Tokenizer, normalizers, pre_tokenizers, processors
from tokenizers.models import BPE

START, END = "<|startoftext|>", "<|endoftext|>"
END_OF_WORD = "</w>"
SIZE = 49_408
WORDS = r"'s|'t|'re|'ve|'m|'ll|'d|[\p{L}]+|[\p{N}]|[^\s\p{L}\p{N}]+"


def byte_symbols():
    """The printable character for each byte, in the order of GPT-2 and CLIP."""
    shown = [*range(33, 127), *range(161, 173), *range(174, 256)]
    hidden = [byte for byte in range(256) if byte not in shown]
    return [chr(byte) for byte in shown] + [chr(256 + at) for at in range(len(hidden))]


def tokenizer(context):
    """A tokenizer that lower-cases, joins white space, adds both ends, cuts at `context` tokens."""
    file = Path(open_clip.__file__).parent / "bpe_simple_vocab_16e6.txt.gz"
    lines = gzip.decompress(file.read_bytes()).decode().split("\n")
    symbols = byte_symbols()
    merges = [tuple(line.split()) for line in lines[1 : SIZE - 2 * len(symbols) - 2 + 1]]
    words = symbols + [symbol + END_OF_WORD for symbol in symbols]
    words += ["".join(pair) for pair in merges] + [START, END]
    assert len(words) == SIZE, len(words)
    ids = {word: at for at, word in enumerate(words)}
    made = Tokenizer(
        BPE(
            ids, merges, end_of_word_suffix=END_OF_WORD, unk_token=END, continuing_subword_prefix=""
        )
    )
    made.normalizer = normalizers.Sequence(
        [normalizers.NFC(), normalizers.Replace(Regex(r"\s+"), " "), normalizers.Lowercase()]
    )
    made.pre_tokenizer = pre_tokenizers.Sequence(
        [
            pre_tokenizers.Split(Regex(WORDS), behavior="removed", invert=True),
            pre_tokenizers.ByteLevel(add_prefix_space=False, use_regex=False),
        ]
    )
    made.post_processor = processors.TemplateProcessing(
        single=f"{START} $A {END}", special_tokens=[(START, ids[START]), (END, ids[END])]
    )
    made.add_special_tokens([START, END])
    made.enable_truncation(context)
    return made
