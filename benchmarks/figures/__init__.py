"""`make figures`: how well forces are read on virtual eyes that no training has seen; `__main__` has the command."""
