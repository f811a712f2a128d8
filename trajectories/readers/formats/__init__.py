"""One module a log format: from its containers to columns of an IMU and what stands beside it."""
