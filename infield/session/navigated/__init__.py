"""Sessions of gyros that find a heading: one navigation filter over align, park and taxi."""
