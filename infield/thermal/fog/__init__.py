"""Fibre-optic gyros: temperature and rate coefficients from ramps; piecewise, whole-number."""
