"""Text that the programs of IMU makers export, known by the names of its columns."""
