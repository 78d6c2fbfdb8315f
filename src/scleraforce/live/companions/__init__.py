"""The monitor's other processes: black box, second opinion, learning, watchdog."""
