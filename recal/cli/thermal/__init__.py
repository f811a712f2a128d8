"""The commands of `recal thermal`."""
