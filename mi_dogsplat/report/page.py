"""The templates of all pages: what is put into one is escaped, and what it misses is an error.

``report/templates/base.html`` is the document around each page, with the one style sheet (light, dark, phone, print);
a page needs nothing but itself.
"""

from __future__ import annotations

from jinja2 import Environment, PackageLoader, StrictUndefined

from ..support.pictures import MAGMA
from ..support.wording import count, duration, finite, fixed

TEMPLATES = Environment(
    loader=PackageLoader("mi_dogsplat", "."),  # by their place in the package, such as check/templates/check.html
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
TEMPLATES.globals["magma"] = MAGMA
TEMPLATES.filters.update(count=count, duration=duration, fixed=fixed)
TEMPLATES.tests["finite"] = lambda value: finite(value) is not None
