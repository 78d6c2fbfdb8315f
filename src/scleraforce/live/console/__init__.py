"""The web console: a process beside the monitor that shows its decisions in a browser
and sends it the reset.
"""
