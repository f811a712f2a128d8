"""The words of every reason, one module a room; `sentences` finds the sentence of a code."""
