"""One power-on session against the stored table, navigated or from parked rates, and the update
over all sessions.
"""
