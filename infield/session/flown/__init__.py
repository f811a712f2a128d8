"""Sessions that fly with a receiver: parked, taxi, flight and what follows as one session."""
