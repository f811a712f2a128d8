"""Effects that only a flight shows."""
