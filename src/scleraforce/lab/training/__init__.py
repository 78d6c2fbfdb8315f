"""Training: the only room that needs PyTorch (extra `train`). It makes the folders that
`reader` loads.
"""
