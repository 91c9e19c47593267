"""The README as PyPI shows it, where no repository lies beside it: a metadata hook of hatch."""

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

PICTURE = re.compile(r"!\[(.*?)\]\((?!\w+:)(.*?)\)\n*")
LINK = re.compile(r"(?<!!)\[(.*?)\]\((?!\w+:|#)(.*?)\)")


def for_pypi(text: str, repository: str | None, version: str) -> str:
    """Make relative paths addresses of this release; without a repository, leave them out."""
    if repository is None:
        return LINK.sub(r"\1", PICTURE.sub("", text))
    shown = PICTURE.sub(rf"![\1]({repository}/raw/v{version}/\2)\n\n", text)
    return LINK.sub(rf"[\1]({repository}/blob/v{version}/\2)", shown)


class ReadmeHook(MetadataHookInterface):
    """Takes the repository from `[project.urls]`."""

    def update(self, metadata: dict) -> None:
        """Put the README into the metadata of the package."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        repository = metadata.get("urls", {}).get("Repository")
        shown = for_pypi(text, repository, metadata["version"])
        metadata["readme"] = {"content-type": "text/markdown", "text": shown}
