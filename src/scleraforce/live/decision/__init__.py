"""The monitor's decision to withdraw, without clock, input or output
(docs/monitor_decision.md).
"""
