"""Which recordings would separate rival effects."""
