"""Sessions of gyros that find no heading (MEMS): zero-rate biases of every stretch of rest."""
