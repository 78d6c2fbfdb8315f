"""The processes beside the monitor, and how it talks to them."""
