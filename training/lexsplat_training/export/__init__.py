"""Networks written as ONNX graphs, and bundles of them with a manifest."""
