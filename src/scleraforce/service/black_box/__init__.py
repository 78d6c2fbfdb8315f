"""The black box: the process that logs every decision and keeps frames and forces."""
