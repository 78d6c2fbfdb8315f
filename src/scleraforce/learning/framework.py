"""PyTorch and ONNX, with one clear line where they are not installed."""

from scleraforce.errors import InputError

try:
    import onnx
    import torch
except ModuleNotFoundError as fault:
    raise InputError(f"training needs {fault.name}, which is not installed: pip install 'scleraforce[train]'") from None

__all__ = ["onnx", "torch"]
