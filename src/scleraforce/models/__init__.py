"""Folders of ONNX models: what stands in them, their hashes, how they are written."""
