"""Truth as functions of time, ideal sensors, imperfections of unit and vehicle, scenarios."""
