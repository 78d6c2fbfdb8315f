"""PyTorch and ONNX, with one clear line where they are not installed."""

import os

from scleraforce.errors import InputError

# Threads that wait by spinning take the cores from whoever else needs them, and from each other: on a busy machine an
# epoch then takes five times as long. OpenMP reads this when PyTorch loads it.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

try:
    import onnx as onnx
    import torch as torch
except ModuleNotFoundError as fault:
    raise InputError(f"training needs {fault.name}, which is not installed: pip install 'scleraforce[train]'") from None
