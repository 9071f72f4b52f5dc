"""Reports as one HTML file with everything in it, so that it can be sent to somebody and read without a network."""

from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined


def rendered(package: str, **values: Any) -> str:
    """The page that ``report.html.j2`` of a package, which extends ``page.html.j2`` here, makes of ``values``.

    Whatever is in ``values`` is text, not HTML, unless it is `markupsafe.Markup`.
    """
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader("coordinator", ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(values)
