"""Whole sessions of virtual eyes before the monitor, without sockets: what
`bench_monitor_sessions.py` plays.
"""
