"""What the sessions of a fleet say about its units: how they start, wander and age (`learn`), and
when their drift will pass a limit (`forecast`).

Reading order: `parameters`, `kept`, `likelihood`, `draws`, `learn`, `forecast`.
"""
