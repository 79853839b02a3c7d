"""Network definitions in PyTorch, and weight files read into them."""
