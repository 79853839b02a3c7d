"""Labelled frames and photographs, augmented and drawn as training batches."""
