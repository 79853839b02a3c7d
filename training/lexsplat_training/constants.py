"""Sizes and words that training, export and measuring share. Shapes are (rows, columns)."""

IMAGE_SHAPE = (288, 384)  # input of models/tiny's first encoder, pixels
SECOND_SHAPE = (384, 512)  # input of its second encoder and of the whole bundle, pixels
STRIDE = 4  # pixels per cell of the feature grid and of label maps, along each axis
FEATURE_SIZE = 384  # channels of models/tiny's features: those of the sentence encoder
CODE_SIZE = 32  # channels of the generic codes of every bundle
MEAN = STD = 127.5  # models/tiny's images are normalised to (value - MEAN) / STD
NEGATIVES = ("object", "things", "stuff", "texture")  # the relevancy compares a word with these
