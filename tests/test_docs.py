"""The documentation: every link leads somewhere, every page is in the site, its Python runs."""

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml
from hatchling.metadata.core import ProjectMetadata
from hatchling.plugin.manager import PluginManager
from npe2 import PluginManifest

from napari_splinesketch import __version__, write_labels
from napari_splinesketch.labels import Label, Labels

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = {
    path.relative_to(ROOT).as_posix(): path for path in [ROOT / "README.md", *DOCS.glob("*.md")]
}
TEXTS = {name: path.read_text(encoding="utf-8") for name, path in PAGES.items()}
PYTHON = re.compile(r"```python\n(.*?)```", re.S)
RUN_ELSEWHERE = {"README.md", "docs/active_contours.md", "docs/batch.md", "docs/method.md"}
"""Pages whose blocks have tests of their own, which also look at what comes out."""


def anchors(text: str) -> set[str]:
    """The fragments of a page, as the site makes them of its headings."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    headings = re.findall(r"^#+ +(.*?) *#*$", prose, re.M)
    plain = (re.sub(r"\[(.*?)\]\(.*?\)|[`*]", r"\1", heading) for heading in headings)
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", h).strip().lower()) for h in plain}


@pytest.mark.parametrize("name", PAGES)
def test_links_and_pictures_lead_somewhere(name: str) -> None:
    text = re.sub(r"```.*?```|`[^`\n]*`", "", TEXTS[name], flags=re.S)
    for link in re.findall(r"\]\((?!\w+:)([^)\s]+)", text):
        path, _, fragment = link.partition("#")
        target = (PAGES[name].parent / path).resolve() if path else PAGES[name]
        assert target.exists(), link
        if fragment and target.suffix == ".md":
            assert fragment in anchors(target.read_text(encoding="utf-8")), link


def test_every_page_is_in_the_site_once() -> None:
    site = yaml.safe_load((DOCS / "mkdocs.yml").read_text(encoding="utf-8"))
    pages = re.findall(r"[\w/]+\.md", str(site["nav"]))
    assert sorted(pages) == sorted(path.name for path in DOCS.glob("*.md"))


def test_files_of_the_code_are_where_the_pages_say() -> None:
    packages = "engine|paper|labels|plugin|cli|tracking|batch|training"
    named = re.compile(rf"`((?:{packages})/[\w/]+\.py)`|\b((?:tests|docs)/[\w/]+\.py)")
    for name, text in TEXTS.items():
        for inside, beside in named.findall(text) if name != "docs/CHANGELOG.md" else ():
            path = ROOT / "src" / "napari_splinesketch" / inside if inside else ROOT / beside
            assert path.exists(), f"{name}: {path}"


@pytest.mark.parametrize(
    "name", [name for name in TEXTS if PYTHON.search(TEXTS[name]) and name not in RUN_ELSEWHERE]
)
def test_the_python_of_a_page_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_labels("labels.csv", Labels((Label.from_sketch(np.eye(2)),)))
    known: dict[str, object] = {}
    for code in PYTHON.findall(TEXTS[name]):
        exec(compile(code, name, "exec"), known)


def test_the_tests_that_pages_name_are_there() -> None:
    named = re.compile(r"`(tests/[\w/]+\.py)::(\w+)`")
    found = [(name, *match) for name, text in TEXTS.items() for match in named.findall(text)]
    assert len(found) > 20
    for name, path, test in found:
        code = (ROOT / path).read_text(encoding="utf-8")
        assert f"\ndef {test}(" in code, f"{name}: {path}::{test}"


def test_there_is_one_version_and_the_hub_finds_what_it_shows() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    place = ROOT / settings["tool"]["hatch"]["version"]["path"]
    assert f'__version__ = "{__version__}"' in place.read_text(encoding="utf-8")
    assert "Framework :: napari" in settings["project"]["classifiers"]
    assert PluginManifest.from_distribution("napari-splinesketch").categories


@pytest.mark.parametrize("repository", [None, "https://example.org/splines"])
def test_pypi_shows_the_readme_without_paths_into_the_repository(repository: str | None) -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    settings["project"]["urls"] = {"Repository": repository} if repository else {}
    core = ProjectMetadata(str(ROOT), PluginManager(), settings).core
    targets = re.findall(r"\]\((.*?)\)", core.readme)
    assert core.readme_content_type == "text/markdown"
    assert "## In Python" in core.readme
    assert all(target.startswith("https://") for target in targets)
    pictures = re.findall(r"^!\[.*?\]\((.*?)\)$", core.readme, re.M)
    ours = f"{repository}/raw/v{__version__}/"
    shown = [target.removeprefix(ours) for target in pictures if target.startswith(ours)]
    there = re.findall(r"^!\[.*?\]\((.*?)\)$", TEXTS["README.md"], re.M)
    assert len(there) > 3
    assert shown == (there if repository else [])
    assert (f"{repository}/blob/v{__version__}/docs/index.md" in targets) == bool(repository)


def test_the_api_page_shows_what_it_names() -> None:
    """A function of its module's name would be taken for the module, and not be shown."""
    blocks = re.findall(r"^::: (\S+)\n.*?members: \[(.*?)\]", TEXTS["docs/api.md"], re.M | re.S)
    assert len(blocks) > 3
    for module, members in blocks:
        folder = ROOT / "src" / module.replace(".", "/")
        assert not any((folder / f"{name}.py").exists() for name in members.split(", ")), module


def test_every_extra_is_explained() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    table = TEXTS["docs/index.md"].split("## What needs which extra")[1].split("\n## ")[0]
    named = {name for row in re.findall(r"^\| (`.*?) \|", table, re.M) for name in row.split(", ")}
    assert named == {f"`{name}`" for name in settings["project"]["optional-dependencies"]}


def test_the_citation_is_complete() -> None:
    cited = yaml.safe_load((DOCS / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors", "license"} <= set(cited)
    assert all(author.get("name") or author.get("family-names") for author in cited["authors"])


def test_every_promise_names_a_test_that_is_there() -> None:
    table = TEXTS["docs/safety.md"].partition("|---|---|---|\n")[2].partition("\n\n")[0]
    for row in table.splitlines():
        named = re.findall(r"`(tests/\S+?\.py)::(\w+)`", row)
        assert named, row
        for path, name in named:
            assert f"def {name}(" in (ROOT / path).read_text(encoding="utf-8"), name
