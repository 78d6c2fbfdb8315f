"""`make figures`: accuracy of the forces read on virtual eyes that no training has
seen; `__main__` has the command.
"""
