"""Tables inside pages: what stands between two markers is replaced, the rest stays."""

import re
from pathlib import Path

METHOD_PAGE = Path(__file__).parents[2] / "docs" / "method.md"


def insert(name: str, text: str, page: Path = METHOD_PAGE) -> None:
    """Put `text` between `<!-- name -->` and `<!-- /name -->`."""
    old = page.read_text(encoding="utf-8")
    pattern = rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)"
    new, found = re.subn(pattern, lambda m: f"{m[1]}{text}{m[2]}", old, flags=re.DOTALL)
    if found != 1:
        raise ValueError(f"{page} has {found} places marked {name!r}; it needs exactly one.")
    page.write_text(new, encoding="utf-8")
