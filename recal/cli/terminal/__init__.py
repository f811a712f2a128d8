"""What a command shares with the terminal and its user: help, progress, the user's own defaults."""
