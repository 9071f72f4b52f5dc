"""Render reports as one self-contained HTML file, which can be sent to somebody and read without a network."""

from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined


def rendered(package: str, **values: Any) -> str:
    """Return the HTML page that a package's template ``report.html.j2`` makes of ``values``.

    The template extends ``page.html.j2`` of this package. Values are escaped, unless they are `markupsafe.Markup`.
    """
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader("coordinator.experiments", ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(values)
