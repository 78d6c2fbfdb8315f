"""Read force class and force from frames with a trained model: NumPy, OpenCV and ONNX
Runtime only.
"""
