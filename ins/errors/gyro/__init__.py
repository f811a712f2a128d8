"""Errors of gyros: of temperature, events, rates, noise, and of the table misapplied."""
