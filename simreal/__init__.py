"""The sim-to-real gap: where simulator and logs disagree, and which effect causes it.

Reading order: `inference.diagnosis` (the spine), `evidence`, `effects`, `inference`, `plan`.
"""
