"""The messages of proto/lexsplat/v1/lexsplat.proto, made by `generate.py`."""
