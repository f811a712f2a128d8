"""Answers of the whole program on named inputs, frozen before a large change and asked after it.

    python -m tests.frozen compare|renew [KIND ...] [--only NAME] [--quick]

KIND is motion, sessions, aided, diagnoses or twin_fits; all without one.

`cases` names the inputs, `answers` reads means, sigmas, verdicts and names off the documents of the
front door, `__main__` asks, compares and writes one file a kind.
"""
