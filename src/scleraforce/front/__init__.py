"""What people call: the Python functions, the commands, the app and the pages.

Imports every other package.
"""
