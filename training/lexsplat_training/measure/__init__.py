"""Scores of a bundle, reference pictures for the renderer, and figures."""
