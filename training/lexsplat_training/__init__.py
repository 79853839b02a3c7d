"""Renders training scenes, trains and exports the networks of lexsplat's bundles, measures them."""
