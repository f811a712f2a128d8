"""The program: the command line over all other packages."""
