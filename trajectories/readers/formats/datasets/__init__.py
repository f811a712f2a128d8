"""Public data sets of drives and flights, as the folders they are published in."""
