"""The documents and pages of `recal diagnose` and `recal plan`."""
