"""The product: recalibrate a gyro's thermal table in the field (US 5,527,003).

Reading order: `session.pipeline` (the spine), `session.one_run`, `session.navigated`,
`session.points`, `table`, `session.acceptance`, `store`, `reports`.
"""
