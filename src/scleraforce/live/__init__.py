"""The monitor on the network: what robots, viewers and people talk to."""
