"""Templates of the HTML pages that reports and the paper are written to."""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined


def page_templates(package: str) -> Environment:
    """Return the environment of the templates of a package: text is escaped, a gap is an error.

    Args:
        package: with a folder ``templates``, such as ``mottrack.report``.
    """
    environment = Environment(
        loader=PackageLoader(package),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"sort_keys": False}  # tables have an order
    return environment
