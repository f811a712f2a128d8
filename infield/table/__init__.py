"""The thermal bias table: nodes with their joint covariance, its prior, files, the Bayesian merge,
autopilot cubics.
"""
