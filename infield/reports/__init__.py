"""Report pages, each one self-contained HTML file drawn from its document; the drawings they
share.
"""
