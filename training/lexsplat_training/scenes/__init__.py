"""Furnished rooms from a seed, ray cast on the CPU as labelled RGB frames."""
