"""Which wall of the library do frames show? For n frames and planes, forces known or
not.
"""
