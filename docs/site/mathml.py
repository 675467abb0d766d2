"""Equations (```math blocks, which GitHub shows, too) as MathML, which browsers draw themselves, without any script."""

from latex2mathml.converter import convert


def display(source: str, language: str, css_class: str, options: object, md: object, **more: object) -> str:
    """A fence of pymdownx.superfences."""
    return str(convert(source.strip(), display="block"))
