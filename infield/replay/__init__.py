"""A logged session navigated again: free-inertially with each of several tables, and aided by
satellites.
"""
