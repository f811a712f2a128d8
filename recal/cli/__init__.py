"""One module a command: `command()` parses, calls one function of the packages below, prints.

Heavy imports stand inside the functions, so that `recal --help` stays quick.
"""
