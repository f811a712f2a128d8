"""Workers of a fleet update: on this machine or a Dask cluster, what one does, the journal that
survives kills.
"""
