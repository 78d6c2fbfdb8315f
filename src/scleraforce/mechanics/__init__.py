"""Mechanics of the wall: displacement under eye pressure, gravity and the needle."""
