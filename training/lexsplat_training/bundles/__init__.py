"""Bundles of published networks, from a hub to a folder that the server loads."""
