"""The review page of `recal serve`: stored tables, proposed updates, diagnosis reports; approve,
reject, roll back.

Reading order: `settings` (who may come in), `connections` (who is heard), `guard` (what every
request must pass), `door` (tokens, sessions, form tokens), `site` (what the routes share), `pages`
(what is read), `actions` (what is written), `app` (the pieces together). Needs the extra `web`.
"""
