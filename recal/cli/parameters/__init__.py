"""The parameters of commands: those that commands share, and those that come from a verb."""
