"""The commands of `recal table`."""
