"""Results as the plain JSON documents of formats.md; the pages are drawn from these alone."""
