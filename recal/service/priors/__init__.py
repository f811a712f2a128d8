"""Priors learnt from the sessions kept in a store: learn, keep, use."""
