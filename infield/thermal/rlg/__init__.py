"""Ring-laser gyros: temperature, rate and gradient terms from runs at rest."""
