"""The `effects` of a twin file: read, checked against the catalogue, and the free functions among
them.
"""
