"""Losses and training loops of the networks of `models/tiny`."""
