"""Satellite-aided replay: start, noise and antenna found from the log, the flight itself, what it
must not be believed.
"""
