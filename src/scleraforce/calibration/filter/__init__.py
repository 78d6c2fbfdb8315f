"""The reduced-order unscented Kalman filter over the frames of an eye."""
