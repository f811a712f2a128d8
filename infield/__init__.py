"""The product: recalibrate a gyro's thermal table in the field (US 5,527,003).

Reading order: pipeline (the spine), session, taxi_heading, bias_points, claim_chain, table, merge,
acceptance, store, document, report.
"""
