"""A recording played to a monitor as its scanner would, with faults on request."""
