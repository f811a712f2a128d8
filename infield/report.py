"""Placeholder replaced below."""


def update_html(document: dict) -> str:
    return "<html></html>"
