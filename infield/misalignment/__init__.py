"""Gyro misalignment from parked stops on several azimuths."""
