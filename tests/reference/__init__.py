"""Slow, literal versions of the papers' algorithms: oracles for the tests, never shipped."""
