"""One estimator: a tape says what it is to do, one compiled kernel works through it."""
