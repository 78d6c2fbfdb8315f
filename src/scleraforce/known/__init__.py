"""What is known of an eye before a frame is read: from options, its recording, or a calibration file."""
