"""The review page of `recal serve`: stored tables, proposed updates, diagnosis reports; approve,
reject, roll back.

Reading order: `settings` (who may come in), `guard` (what every request must pass), `door` (tokens,
sessions, form tokens), `app` (the pieces together), `pages` (what is read), `actions` (what is
written). Needs the extra `web`.
"""
